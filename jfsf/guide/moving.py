""".. include:: moving.md"""
