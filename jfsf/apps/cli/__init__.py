"""The command line, `jfsf`: demo, match, register, batch, evaluate, ...

What only one command needs is imported inside it.

Read in this order:

- `_options`: the options that several commands have
- `_files`: the files that the commands read and check
- `_print`: messages in the words of the command line, and the stage
- `_stored`: maps as they are written, and read again with their meshes
- `_known`: landmarks and ground truth of a pair
- `_pair`: what `jfsf match` does with a pair, and `jfsf batch` with each
- `_components`: `jfsf match --components`
- `_register`: `jfsf register`
- `_match`: `jfsf match`
- `_demo`: the comparison that `jfsf demo` runs
- `_stages`: the stages of a run of many jobs, as bars or as lines
- `_runs`: what the commands of many jobs share
- `_summary`: the results of many pairs, as a table and as files
- `_batch_jobs`: the options of each pair of `jfsf batch`, and its jobs
- `_batch`: `jfsf batch`
- `_collection_jobs`: the jobs of `jfsf collection`
- `_look`: what is unfit in a folder of meshes, and what mends it
- `_collection_carried`: landmarks, labels and values of the template on all shapes
- `_collection_symmetry`: left and right landmarks
- `_collection_people`: landmarks that people placed on shapes, in a folder of files
- `_collection_results`: what is written of all shapes when they are done
- `_collection_runner`: makes the jobs, and reads what they wrote
- `_collection_frozen`: a finished collection, which is only read
- `_collection_onto`: new shapes onto it
- `_collection_templates`: other templates, each put on all shapes
- `_collection_landmarks`: the template's landmarks on all shapes, and how sure they are
- `_collection_check`: these beside those that people placed, and two simple methods
- `_collection_marks`: all landmarks of a run
- `_collection`: `jfsf collection`
- `_morphometrics_compared`: what is computed of specimens
- `_morphometrics_results`: tables, ends of components and pictures of specimens
- `_morphometrics`: `jfsf morphometrics`
- `_transfer`: `jfsf transfer`
- `_evaluate`: `jfsf evaluate`
- `_info`: `jfsf info`
- `_app`: the application, its small commands, and exit codes
"""

from jfsf.apps.cli._app import main

__all__ = ["main"]
