""".. include:: stages.md"""
