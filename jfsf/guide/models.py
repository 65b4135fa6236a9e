""".. include:: models.md"""
