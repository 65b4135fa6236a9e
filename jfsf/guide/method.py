""".. include:: method.md"""
