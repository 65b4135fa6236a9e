"""The command line, `jfsf`: demo, match, register, batch, evaluate, ...

What only one command needs is imported inside it.

Read in this order:

- `_words`: messages in the words of the command line
- `_files`: the files that the commands read, check and write
- `_stored`: two meshes and a map that was written
- `_landmarks`: the landmarks of `jfsf match` and `jfsf batch`
- `_notes`: what these two say of the meshes of a pair
- `_exports`: what they draw and export
- `_stages`: a bar that names the stage
- `_components`: `jfsf match --components`
- `_report`: the certificate as a table, and the figures of a map
- `_summary`: the results of many pairs, as a table and as files
- `_pages`: the reports of the commands
- `_demo`: the comparison that `jfsf demo` runs
- `_runs`: what the commands of many jobs share
- `_batch_options`: the options of each pair of `jfsf batch`
- `_batch_jobs`: its jobs
- `_batch`: `jfsf batch`
- `_collection_jobs`: the jobs of `jfsf collection`
- `_collection_carried`: what the template has, on each shape of a collection
- `_collection_runner`: makes the jobs, and reads what they wrote
- `_collection_results`: what is written of all shapes when they are done
- `_collection`: `jfsf collection`
- `_register`: `jfsf register`
- `_transfer`: `jfsf transfer`
- `_evaluate`: `jfsf evaluate`
- `_info`: `jfsf info`
- `_warm_up`: `jfsf warm-up`
- `_shapes`: `jfsf shapes`
- `_cache`: `jfsf cache`
- `_app`: the other commands, options, and exit codes
"""

from jfsf.apps.cli._app import app, main

__all__ = ["app", "main"]
