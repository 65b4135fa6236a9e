"""The guides of the manual, a page each.

They are the Markdown files in this folder, NAME.md; `python -m jfsf.apps.guide FOLDER`
builds them, with the pages of the whole package, as HTML. Begin with the first:

- `start`: from two meshes to a map that has been looked at
- `method`: notation, the direction of every map, the search and the certificate
- `meshes`: formats, repair, units, exit codes, maps on disk
- `landmarks`: points that are known to correspond
- `programs`: 3D Slicer, MeshLab, Blender, ParaView and ShapeWorks
- `parts`: a shape that is a part of the other, or overlaps it
- `registration`: a template mesh deformed onto a scan
- `transfer`: values, labels, landmarks and textures of one shape on another
- `far`: bodies of different proportions, and how reliable a map is
- `large`: a hundred thousand vertices, and a million
- `batches`: many pairs, on many processes and machines
- `collections`: from a folder of scans to one topology and a model
- `models`: the mean of many shapes, and how they vary
- `morphometrics`: landmarks of many specimens, superimposed and compared
- `gpus`: what runs on a GPU, how fast, and what is checked without one
- `stages`: settings, converters, descriptors, initial maps; the folders
- `jax`: static and traced arguments, vmap, shard_map, export, solvers, own kernels
- `gradients`: through the filter and the refinement, and learning
- `moving`: from pyFM, MATLAB and others, with a table of equivalents
- `troubleshooting`: by symptom
"""
