""".. include:: registration.md"""
