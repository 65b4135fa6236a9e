""".. include:: collections.md"""
