""".. include:: parts.md"""
