""".. include:: batches.md"""
