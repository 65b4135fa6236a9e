""".. include:: start.md"""
