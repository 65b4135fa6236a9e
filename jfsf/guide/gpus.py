""".. include:: gpus.md"""
