""".. include:: large.md"""
