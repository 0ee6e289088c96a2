# SPDX-License-Identifier: Apache-2.0
"""vdb_read.py FILE OUT: reads the only grid of an OpenVDB file with OpenVDB's own Python module. Writes the samples in the box of its active voxels to OUT
(float, axis 2 fastest), and prints the rest as JSON. Runs with the Python of the system, because Debian's python3-openvdb needs Debian's numpy."""
import json
import sys

import numpy
import pyopenvdb

(grid,), metadata = pyopenvdb.readAll(sys.argv[1])
first, last = grid.evalActiveVoxelBoundingBox()
samples = numpy.zeros([b - a + 1 for a, b in zip(first, last)], 'f4')
grid.copyToArray(samples, ijk=first)
samples.tofile(sys.argv[2])
print(json.dumps({'name': grid.name, 'class': grid.gridClass, 'type': type(grid).__name__, 'creator': metadata['creator'], 'background': grid.background, 'first': first,
                  'dims': samples.shape, 'active': grid.activeVoxelCount(), 'box': [grid.metadata['file_bbox_min'], grid.metadata['file_bbox_max']],
                  'world': [grid.transform.indexToWorld(i) for i in ((0, 0, 0), (1, 0, 0), (0, 1, 0), (0, 0, 1))]}))
