# SPDX-License-Identifier: Apache-2.0
"""Files made after public reports of problems with other programs, in DATA/reports. The right values stand in expected.txt beside each file."""
import glob
import json
import os

import numpy


def world(info, index):
    """The positions of samples (…, 3), x y z."""
    matrix = numpy.reshape(info['direction'], (3, 3)) * info['spacing']
    return numpy.asarray(index) @ matrix.T + info['origin']


def ramp_of(x, y, z):
    """The number of a sample in a grid of 10 × 8 × n."""
    return (z * 8 + y) * 10 + x


class Reports:
    def __init__(self, tool):
        self.tool = tool

    def path(self, *names):
        path = os.path.join(self.tool.data, 'reports', *names)
        if os.path.exists(path):
            return path
        self.tool.skipped.append(f'{path} is missing')
        return None

    def grid(self, source, dims, value, spacing, origin=(0, 0, 0), direction=numpy.eye(3), step=0, **wanted):
        """Each sample has value(x, y, z) of the index that its place in the world has on this grid."""
        if source is None:
            return
        info, samples = self.tool.dump(source, step)
        if info is None:
            return
        self.tool.checks += 1
        if sorted(info['dims']) != sorted(dims):
            self.tool.fail(source, f'dims {info["dims"]}, expected {dims}')
            return
        index = numpy.stack(numpy.meshgrid(*(numpy.arange(n) for n in info['dims']), indexing='ij'), -1)
        matrix = numpy.asarray(direction, float) * (spacing or info['spacing'])
        places = (world(info, index) - origin) @ numpy.linalg.inv(matrix).T
        rounded = numpy.rint(places)
        if numpy.abs(places - rounded).max() > 0.05 or rounded.min() < 0 or (rounded.max((0, 1, 2)) >= dims).any():
            self.tool.fail(source, f'samples lie at {places.min((0, 1, 2))} to {places.max((0, 1, 2))} of the grid, spacing {info["spacing"]}, origin {info["origin"]}')
            return
        expected = value(rounded[..., 0], rounded[..., 1], rounded[..., 2])
        if not numpy.allclose(samples.transpose(2, 1, 0), expected, rtol=1e-6, atol=0, equal_nan=True):
            self.tool.fail(source, f'the samples are {samples.ravel()[:6]}, expected {expected.transpose(2, 1, 0).ravel()[:6]}')
        for key, right in wanted.items():
            if info.get(key) != right:
                self.tool.fail(source, f'{key} is {info.get(key)}, expected {right}')

    def channels(self, source, dims, spacing, more):
        """Two channels; the second is the first plus a number."""
        info, first = self.tool.dump(source)
        self.tool.checks += 1
        if info is None:
            return
        other = info.get('other0')
        _, second = self.tool.dump(f'{source}?field={other}')
        if info['dims'] != list(dims) or second is None or not numpy.array_equal(second, first + more) or not numpy.allclose(info['spacing'], spacing, rtol=1e-4):
            self.tool.fail(source, f'dims {info["dims"]}, spacing {info["spacing"]}, other field {other}')

    def spread(self, source, low, high, count):
        """The range of the finite samples and the number of the others."""
        info, samples = self.tool.dump(source)
        self.tool.checks += 1
        if info is None:
            return
        finite = samples[numpy.isfinite(samples)]
        if not numpy.allclose([finite.min(), finite.max()], [low, high], rtol=1e-2) or samples.size - finite.size != count:
            self.tool.fail(source, f'{finite.min()} to {finite.max()}, {samples.size - finite.size} are no numbers')

    def either(self, name, wanted):
        """The samples are right, or there is a warning or an error."""
        source = self.path(*name.split('/'))
        if not source:
            return
        done, out = self.tool.run(source)
        self.tool.checks += 1
        if done.returncode == 0:
            info = json.loads(done.stdout)
            samples = numpy.fromfile(out, info['type'])
            if (samples.min(), samples.max()) != wanted and not info.get('warnings'):
                self.tool.fail(source, f'{samples.min()} to {samples.max()} without a warning, expected {wanted}')


def check_frames(r):
    dims, spacing = (10, 8, 6), (0.7, 0.5, 2)
    path = lambda name: r.path(name, 'data', 'x.dcm')
    scaled = lambda x, y, z: 2 * ramp_of(x, y, z) - 100
    r.grid(path('01-dicom-enhanced-shuffled'), dims, scaled, spacing, (5, 6, 0), unit='mm', anatomy='LPS')
    r.grid(path('02-dicom-enhanced-descending'), dims, scaled, spacing, (5, 6, 0))
    r.grid(path('03-dicom-enhanced-sagittal'), dims, scaled, (0.7, 0.5, 3), (0, 1, 2), [[0, 0, 1], [1, 0, 0], [0, -1, 0]])
    r.grid(path('04-dicom-nm-negative-spacing'), dims, ramp_of, spacing, (1, 2, 10), numpy.diag([1, 1, -1]))
    r.grid(path('05-dicom-enhanced-slopes'), dims, lambda x, y, z: ramp_of(x, y, z) * (z + 1), spacing, (5, 6, 0))
    for step in (0, 1):
        r.grid(path('07-dicom-enhanced-times'), dims, scaled, spacing, (5, 6, 0), step=step, steps=2)
    r.grid(path('08-dicom-sc-multiframe'), dims, ramp_of, (0.3, 0.3, 0.3))
    r.grid(path('50-dicom-rtdose'), dims, lambda x, y, z: 0.001 * ramp_of(x, y, z), (0.7, 0.5, 2.5), (1, 2, 3))


def check_folders(r):
    dims, spacing = (10, 8, 6), (0.7, 0.5, 2)
    for step in (0, 1, 2):
        for source in (r.path('09-dicom-4d-folder', 'data'), r.path('09-dicom-4d-folder', 'data', 'IM0001.dcm')):
            r.grid(source, (10, 8, 4), lambda x, y, z: ramp_of(x, y, z) + 1000 * step, spacing, step=step, steps=3)
    for name in ('10-dicom-duplicate', '11-dicom-dicomdir-beside', '12-dicom-stray-files'):
        r.grid(r.path(name, 'data'), dims, ramp_of, spacing)
    r.grid(r.path('15-dicom-float-pixels', 'data'), (10, 8, 3), lambda x, y, z: 0.5 * ramp_of(x, y, z), spacing, type='float32')
    r.grid(r.path('43-dicom-jitter', 'data'), dims, ramp_of, (0.7, 0.5, 1.598))
    tilted = [[1, 0, 0], [0, 0.9659258, 0], [0, -0.2588190, 1]]
    r.grid(r.path('48-dicom-gantry-tilt', 'data'), dims, ramp_of, spacing, direction=tilted)
    r.grid(r.path('49-dicom-signed-12-bit', 'data'), dims, lambda x, y, z: ramp_of(x, y, z) - 240, spacing)


def check_tiff(r):
    dims = (48, 32, 6)
    small = lambda x, y, z: ((z * 32 + y) * 48 + x) % 251
    r.grid(r.path('19-tiff-float16', 'e5_f2.tif'), dims, small, (1, 1, 1))
    r.grid(r.path('21-tiff-thumbnail', 'e11_mixed.tif'), dims, small, (1, 1, 1))
    for name, spacing in (('20-tiff-shaped-czyx/e9_shaped_czyx.tif', (1, 1, 1)), ('57-imagej-hyperstack/*.tif', (0.2, 0.2, 0.5))):
        files = glob.glob(os.path.join(r.tool.data, 'reports', name))
        for path in files:
            r.channels(path, dims, spacing, 1 if name[:2] == '20' else 1000)


def check_medical(r):
    dims, spacing = (4, 5, 6), (0.5, 0.5, 2)
    small = lambda x, y, z: ((z * 5 + y) * 4 + x) % 100
    for name in ('23-nrrd-uint32/b8_unsigned_int.nrrd', '24-nrrd-int64/b8_long_long.nrrd', '25-nrrd-ascii/b5_ascii.nrrd'):
        r.grid(r.path(*name.split('/')), dims, small, spacing, (1, 2, 3))
    rgb = r.path('26-nrrd-rgb', 'b3c_rgbcolor.nrrd')
    if rgb:
        info, _ = r.tool.dump(rgb)
        names = info and [info['name'], info.get('other0'), info.get('other1')]
        r.tool.checks += 1
        if info and (names != ['red', 'green', 'blue'] or info['type'] != 'uint8' or not numpy.allclose(info['spacing'], spacing)):
            r.tool.fail(rgb, f'fields {names}, type {info["type"]}, spacing {info["spacing"]}')
    r.either('29-nifti-vox-offset-0/a10_off0.nii', (0, 199))
    # expected.txt gives the origin (1, 2, 3), but these are the axis numbers; the field ORIGIN of the header is 0.
    r.grid(r.path('36-mrc', 'k2.mrc'), (10, 8, 6), ramp_of, (0.7, 0.5, 2))
    for path in glob.glob(os.path.join(r.tool.data, 'reports', '53-nrrd-byteskip-minus1', '*.nhdr')):
        r.grid(path, dims, small, spacing, (1, 2, 3))
    for path in glob.glob(os.path.join(r.tool.data, 'reports', '55-tiny-values', '*.nii*')):
        r.spread(path, 0, 9.84e-31, 0)
    for path in glob.glob(os.path.join(r.tool.data, 'reports', '56-nan-outside', '*.nii*')):
        r.spread(path, 60.2, 148.4, 5392)


def check_arrays(r):
    dims, spacing = (10, 8, 6), (0.7, 0.5, 2)
    r.grid(r.path('31-vti-cell-data', 'g1.vti'), dims, ramp_of, spacing, (1.35, 2.25, 4))
    r.grid(r.path('33-vtk-pvti', 'g10.pvti'), dims, ramp_of, spacing, (4.5, 3, 5))
    r.grid(r.path('34-hdf5-lzf', 'h2.h5'), dims, ramp_of, (1, 1, 1))
    holed = lambda x, y, z: numpy.where((z == 2) | (z == 3), 7, ramp_of(x, y, z))
    empty = lambda x, y, z: numpy.where(z < 2, 0, ramp_of(x, y, z))
    for name, value in (('44-zarr-xyz-axes', ramp_of), ('45-zarr-missing-chunk', holed), ('46-zarr-sharded', empty)):
        for path in glob.glob(os.path.join(r.tool.data, 'reports', name, '*.zarr')):
            r.grid(path, dims, value, None)


def check(tool):
    r = Reports(tool)
    if not r.path():
        return
    for part in (check_frames, check_folders, check_tiff, check_medical, check_arrays):
        part(r)
