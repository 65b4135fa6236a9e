""".. include:: far.md"""
