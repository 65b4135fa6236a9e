""".. include:: troubleshooting.md"""
