""".. include:: transfer.md"""
