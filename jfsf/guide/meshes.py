""".. include:: meshes.md"""
