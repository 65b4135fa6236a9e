""".. include:: programs.md"""
