""".. include:: gradients.md"""
