# SPDX-License-Identifier: Apache-2.0
"""TIFF, OME-TIFF and hyperstacks of ImageJ against tifffile."""
import numpy
import tifffile

from ramp import ramp


def check_ome(tool):
    data = ramp((2, 3, 4, 5, 6), 'u2')  # t, c, z, y, x
    place = {'PhysicalSizeX': 0.5, 'PhysicalSizeXUnit': 'µm', 'PhysicalSizeY': 500, 'PhysicalSizeYUnit': 'nm', 'PhysicalSizeZ': 0.002,
             'PhysicalSizeZUnit': 'mm', 'TimeIncrement': 3, 'TimeIncrementUnit': 's', 'Channel': {'Name': ['DAPI', 'GFP', 'GFP']}}
    for axes in ('TCZYX', 'ZCTYX'):
        path = tool.path(f'{axes}.ome.tif')
        turned = numpy.moveaxis(data, range(3), [axes.index(a) for a in 'TCZ'])
        tifffile.imwrite(path, turned, metadata={'axes': axes, **place}, photometric='minisblack')
        for step, channel, name in ((0, 1, 'GFP'), (1, 2, 'channel 3')):
            tool.equal(f'{path}?field={name}', data[step, channel], step=step, steps=2, times=[0, 3], time_unit='s', name=name,
                       spacing=[0.5, 0.5, 2], unit='um')
    path = tool.path('rgb.ome.tif')
    colours = ramp((4, 5, 6, 3), 'u1')
    tifffile.imwrite(path, colours, metadata={'axes': 'ZYXS'}, photometric='rgb')
    tool.equal(f'{path}?field=green', colours[..., 1], name='green')
    path = tool.path('large.ome.tif')  # the description is longer than 4 kB
    tifffile.imwrite(path, ramp((30, 5, 6), 'u1'), metadata={'axes': 'ZYX', 'Plane': {'PositionZ': list(range(30)), 'DeltaT': list(range(30))}},
                     photometric='minisblack')
    tool.equal(path, ramp((30, 5, 6), 'u1'))


def check_plain(tool):
    path = tool.path('stack.tif')
    for dtype in ('>u2', '<f8'):
        data = ramp((4, 16, 32), dtype)
        tifffile.imwrite(path, data, photometric='minisblack', metadata=None, byteorder=numpy.dtype(dtype).byteorder.replace('|', '<').replace('=', '<'))
        tool.equal(path, data)
    data = ramp((4, 16, 32), 'u2')
    for how in ({'compression': 'zlib'}, {'tile': (16, 16)}, {'rowsperstrip': 3}, {'bigtiff': True}):
        tifffile.imwrite(path, data, photometric='minisblack', metadata=None, **how)
        tool.equal(path, data)
    for planar, axis in (('contig', 3), ('separate', 1)):
        for how in ({'dtype': 'f4', 'tile': (16, 16)}, {'compression': 'zlib'}, {'rowsperstrip': 3}):
            colours = ramp((4, 16, 32, 3), how.pop('dtype', 'u1'))
            tifffile.imwrite(path, numpy.moveaxis(colours, 3, axis), photometric='rgb', planarconfig=planar, metadata=None, **how)
            if planar == 'separate' and 'compression' in how:
                tool.refused(path, 'PlanarConfiguration', 'planes')
            else:
                tool.equal(f'{path}?field=blue', colours[..., 2], name='blue')


def check_imagej(tool):
    data = ramp((2, 4, 3, 5, 6), 'u2')  # t, z, c, y, x
    path = tool.path('hyper.tif')
    tifffile.imwrite(path, data, imagej=True, resolution=(2, 4), metadata={'axes': 'TZCYX', 'spacing': 3.5, 'unit': 'um', 'finterval': 0.25})
    for step in (0, 1):
        tool.equal(f'{path}?field=channel 2', data[step, :, 1], step=step, steps=2, times=[0, 0.25], spacing=[0.5, 0.25, 3.5], unit='um')
    for name, spacing, unit in (('flybrain.tif', 3.947, 'um'), ('mini-t1-head_bigendian.tif', 1.5, 'mm')):
        sample = tool.sample('tiff', name)
        if sample:
            with tifffile.TiffFile(sample) as file:
                expected = file.asarray()
            info, _ = tool.dump(sample)
            if expected.ndim == 4:  # z, c, y, x
                expected = expected[:, 0]
            tool.equal(sample, expected, unit=unit)
            tool.checks += 1
            if info and abs(info['spacing'][2] - spacing) > 1e-3 * spacing:
                tool.fail(sample, f'spacing {info["spacing"]}, expected {spacing} in z')


def check(tool):
    check_ome(tool)
    check_plain(tool)
    check_imagej(tool)
