""".. include:: landmarks.md"""
