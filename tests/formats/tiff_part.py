# SPDX-License-Identifier: Apache-2.0
"""TIFF, OME-TIFF and hyperstacks of ImageJ against tifffile."""
import itertools
import os
import struct

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
    for axes in map(''.join, itertools.permutations('TCZ')):
        for channels in (3, 4):
            path = tool.path('order.ome.tif')
            array = ramp((2, channels, 5, 6, 7), 'u1')
            tifffile.imwrite(path, array.transpose(*map('TCZ'.index, axes), 3, 4), metadata={'axes': axes + 'YX'}, photometric='minisblack')
            tool.layout('TIFF', 'OME-XML, every DimensionOrder, 3 or 4 channels', f'{path}?field=channel {channels}', array[1, -1], step=1, steps=2)
    check_ome_units(tool)
    path = tool.path('times.ome.tif')
    array = ramp((3, 2, 4, 6, 7), 'u1')
    planes = {'DeltaT': [float(t * t + 0.25) for t in range(3) for _ in range(8)], 'DeltaTUnit': ['ms'] * 24}
    tifffile.imwrite(path, array, metadata={'axes': 'TCZYX', 'Plane': planes}, photometric='minisblack')
    tool.layout('TIFF', 'OME-XML, DeltaT of planes', path, array[2, 0], step=2, result='times of steps', times=[0.25, 1.25, 4.25], time_unit='ms')
    path = tool.path('rgb.ome.tif')
    colours = ramp((4, 5, 6, 3), 'u1')
    tifffile.imwrite(path, colours, metadata={'axes': 'ZYXS'}, photometric='rgb')
    tool.equal(f'{path}?field=green', colours[..., 1], name='green')
    path = tool.path('large.ome.tif')  # the description is longer than 4 kB
    tifffile.imwrite(path, ramp((30, 5, 6), 'u1'), metadata={'axes': 'ZYX', 'Plane': {'PositionZ': list(range(30)), 'DeltaT': list(range(30))}},
                     photometric='minisblack')
    tool.equal(path, ramp((30, 5, 6), 'u1'))


def check_ome_units(tool):
    path = tool.path('units.ome.tif')
    array = ramp((4, 6, 7), 'u1')
    resolution = {'resolution': (20000, 20000), 'resolutionunit': 'CENTIMETER', 'photometric': 'minisblack'}
    tifffile.imwrite(path, array, metadata={'axes': 'ZYX', 'PhysicalSizeZ': 2.0}, **resolution)
    tool.equal(path, array, spacing=[0.0005, 0.0005, 0.002], unit='mm', warned='')
    sizes = {'PhysicalSizeX': 2.0, 'PhysicalSizeXUnit': 'pixel', 'PhysicalSizeY': 3.0, 'PhysicalSizeYUnit': 'pixel', 'PhysicalSizeZ': 4.0}
    tifffile.imwrite(path, array, metadata={'axes': 'ZYX', **sizes}, photometric='minisblack')
    tool.equal(path, array, spacing=[2, 3, 4], unit='pixel', warned='along z (4 um) was not converted to "pixel"')


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
            tool.equal(f'{path}?field=blue', colours[..., 2], name='blue')


def check_imagej(tool):
    data = ramp((2, 4, 3, 5, 6), 'u2')  # t, z, c, y, x
    path = tool.path('hyper.tif')
    tifffile.imwrite(path, data, imagej=True, resolution=(2, 4), metadata={'axes': 'TZCYX', 'spacing': 3.5, 'unit': 'um', 'finterval': 0.25})
    for step in (0, 1):
        tool.equal(f'{path}?field=channel 2', data[step, :, 1], step=step, steps=2, times=[0, 0.25], spacing=[0.5, 0.25, 3.5], unit='um')
    colours = ramp((2, 4, 3, 5, 6, 3), 'u1')
    tifffile.imwrite(path, colours, imagej=True, metadata={'axes': 'TZCYXS'})
    tool.equal(f'{path}?field=channel 6', colours[1, :, 1, ..., 2], step=1, steps=2)
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


def check_imagej_meaning(tool):
    """Calibration, units and places, as ImageJ's Opener reads them."""
    path = tool.path('imagej.tif')
    data = ramp((3, 6, 7), 'u2') * 100

    def write(array, resolution=(2, 4), resolutionunit='none', **lines):
        tifffile.imwrite(path, array, imagej=True, resolution=resolution, resolutionunit=resolutionunit, metadata={'axes': 'ZYX', **lines})

    write(data, cf=0, c0=-1000.5, c1=0.25, vunit='HU')
    tool.layout('TIFF', 'ImageJ: calibration by a straight line', path, data * 0.25 - 1000.5, value_unit='HU', type='float32')
    write(data.astype('u1'), cf=0, c0=-10.0, c1=2.0, vunit='Gray Value')
    tool.layout('TIFF', 'ImageJ: calibration by a straight line', path, data.astype('u1') * 2.0 - 10, value_unit='', type='int16')
    write(data, cf=0, c0=-32768.0, c1=1.0, vunit='gray value')
    tool.layout('TIFF', 'ImageJ: 16 bits with a sign', path, data.astype('i4') - 32768, type='int16')
    write(data.astype('i2'), cf=0, c0=-32768.0, c1=1.0, vunit='gray value')
    tool.layout('TIFF', 'ImageJ: 16 bits with a sign', path, data.astype('i2'), type='int16')
    write(data.astype('f4'), cf=0, c0=5.0, c1=2.0, vunit='mm Hg')
    tool.equal(path, data, value_unit='mm Hg')
    write(data, cf=1, c0=5.0, c1=2.0, c2=0.1, vunit='OD')
    tool.layout('TIFF', 'ImageJ: another calibration', path, data, result='not applied, with a warning', value_unit='',
                warned='no straight line (cf=1, c1=2)')
    for unit, found in (('micron', 'um'), ('\\u00B5m', 'um'), ('inch', 'in'), ('pixel', ''), ('nm', 'nm'), ('\\u00C5', 'A'), ('cm', 'cm')):
        write(data, unit=unit, spacing=-3)
        tool.layout('TIFF', 'ImageJ: unit and spacing', path, data, spacing=[0.5, 0.25, 3], unit=found)
    write(data, unit='um', spacing=3, resolutionunit='centimeter', resolution=(20000, 40000))
    tool.equal(path, data, spacing=[0.5, 0.25, 3], unit='um')
    write(data, unit='mm', yunit='um', zunit='cm', spacing=3)
    tool.equal(path, data, spacing=[0.5, 0.00025, 30], unit='mm')
    for tag, factor in (('inch', 25.4), ('centimeter', 10)):
        write(data, spacing=3, resolutionunit=tag, xorigin=2.0, zorigin=1.0)
        tool.layout('TIFF', 'ImageJ: no unit, so that of the resolution counts for all axes', path, data, unit='mm',
                    spacing=[0.5 * factor, 0.25 * factor, 3 * factor], origin=[-factor, 0, -3 * factor])
    write(data, unit='mm', spacing=3, xorigin=2.0, yorigin=4.0, zorigin=1.0)
    tool.layout('TIFF', 'ImageJ: origin', path, data, origin=[-1, -1, -3], direction=[1, 0, 0, 0, 1, 0, 0, 0, 1])
    write(data, unit='mm', spacing=3, yorigin=4.0, inverty='true')
    tool.layout('TIFF', 'ImageJ: origin', path, data, origin=[0, 1, 0], direction=[1, 0, 0, 0, -1, 0, 0, 0, 1])
    tifffile.imwrite(path, data, imagej=True, metadata={'axes': 'TYX', 'finterval': 0.5, 'tunit': 'min'})
    tool.layout('TIFF', 'ImageJ: frames with a time between them', path, data[2:], step=2, result='steps', times=[0, 0.5, 1], time_unit='min')
    tifffile.imwrite(path, data, imagej=True, metadata={'axes': 'TYX'})
    tool.layout('TIFF', 'ImageJ: frames without one', path, data, result='slices, with a warning', warned='as=time')


def check_shaped(tool):
    """The description of tifffile names the axes of an array whose last dimensions are a page."""
    path = tool.path('shaped.tif')
    grey = {'photometric': 'minisblack'}
    data = ramp((2, 3, 4, 5, 6), 'u2')  # t, c, z, y, x
    tifffile.imwrite(path, data[0], metadata={'axes': 'CZYX'}, **grey)
    tool.layout('TIFF', 'JSON of tifffile, axes CZYX', f'{path}?field=channel 2', data[0, 1], name='channel 2', other0='channel 1')
    tifffile.imwrite(path, data[0], **grey)
    tool.layout('TIFF', 'JSON of tifffile without axes, 4 dimensions (c, z, y, x)', f'{path}?field=channel 3', data[0, 2])
    tifffile.imwrite(path, data.transpose(0, 2, 1, 3, 4), metadata={'axes': 'TZCYX', 'spacing': 2.5, 'unit': 'um'}, resolution=(5000, 5000),
                     resolutionunit='centimeter', **grey)
    tool.layout('TIFF', 'JSON of tifffile: spacing and unit of slices', f'{path}?field=channel 2', data[0, 1], unit='mm', warned='',
                spacing=[0.002, 0.002, 0.0025])
    for step in (0, 1):
        tool.layout('TIFF', 'JSON of tifffile, axes TZCYX', f'{path}?field=channel 2', data[step, 1], step=step, steps=2)
    tifffile.imwrite(path, data[0, 0], metadata={'axes': 'ZYX', 'spacing': 2.5}, resolution=(5, 5), resolutionunit='centimeter', **grey)
    tool.equal(path, data[0, 0], unit='mm', spacing=[2, 2, 2.5], warned='along z (2.5) was not converted to "mm"')
    tifffile.imwrite(path, data[:, 0], metadata={'axes': 'TZYX'}, compression='zlib', predictor=True, tile=(16, 16), bigtiff=True, byteorder='>', **grey)
    tool.layout('TIFF', 'JSON of tifffile, axes TZYX, BigTIFF, tiles, deflate, predictor 2', path, data[1, 0], step=1, steps=2)
    tifffile.imwrite(path, data[0], metadata={'axes': 'CZYX'}, truncate=True, **grey)
    tool.layout('TIFF', 'JSON of tifffile, one directory for all pages (truncated)', f'{path}?field=channel 3', data[0, 2])
    colours = ramp((4, 5, 6, 3), 'u1')
    tifffile.imwrite(path, colours, metadata={'axes': 'ZYXS'}, photometric='rgb')
    tool.layout('TIFF', 'JSON of tifffile, axes ZYXS, RGB', f'{path}?field=blue', colours[..., 2], name='blue')
    tifffile.imwrite(path, numpy.moveaxis(colours, 3, 1), metadata={'axes': 'ZSYX'}, photometric='rgb', planarconfig='separate')
    tool.layout('TIFF', 'JSON of tifffile, axes ZSYX, RGB in planes', f'{path}?field=green', colours[..., 1], name='green')
    check_axes(tool)
    with tifffile.TiffWriter(path) as file:
        file.write(data[0, 0], **grey)
        file.write(data[0, 1, :2, :3], **grey)
    tool.layout('TIFF', 'several arrays of tifffile', path, data[0, 0], result='the first one is read, with a warning')


def check_axes(tool):
    """The letters of the axes count, not how tifffile stores them: three slices may be one page with three samples."""
    path = tool.path('axes.tif')
    rgb = {'photometric': 'rgb', 'planarconfig': 'separate'}
    data = ramp((2, 5, 4, 6, 7), 'u2')
    for axes, array, how, step, field, expected in (
            ('ZYX', data[0, 0, :3], rgb, 0, '', data[0, 0, :3]),
            ('ZYX', data[0, 0], {**rgb, 'compression': 'zlib'}, 0, '', data[0, 0]),
            ('QZYX', data[0], rgb, 0, '?field=channel 4', data[0, 3]),
            ('TZYX', data[0], rgb, 3, '', data[0, 3]),
            ('TCZYX', data, rgb, 1, '?field=channel 3', data[1, 2]),
            ('TZCYX', data, rgb, 1, '?field=channel 3', data[1, :, 2]),
            ('TZCYX', data, {**rgb, 'truncate': True}, 1, '?field=channel 3', data[1, :, 2]),
            ('ZTYX', data[0], rgb, 2, '', data[0, :, 2]),
            ('TYX', data[0, 0], rgb, 3, '', data[0, 0, 3:]),
            ('YXZ', numpy.moveaxis(data[0, 0], 0, 2), {'photometric': 'rgb'}, 0, '', data[0, 0]),
            ('YXC', numpy.moveaxis(data[0, 0], 0, 2), {'photometric': 'rgb'}, 0, '?field=channel 2', data[0, 0, 1:2])):
        tifffile.imwrite(path, array, metadata={'axes': axes}, **how)
        tool.layout('TIFF', 'JSON of tifffile: slices, times or channels as samples of a pixel', path + field, expected, step=step)
    for axes, columns in (('XYZ', [0, 0, 1, 0, 1, 0, 1, 0, 0]), ('ZXY', [0, 1, 0, 1, 0, 0, 0, 0, 1])):
        tifffile.imwrite(path, data[0, 0], metadata={'axes': axes}, photometric='minisblack')
        tool.layout('TIFF', 'JSON of tifffile, axes XYZ or ZXY', path, data[0, 0], direction=columns, result='the directions follow the axes')
    tifffile.imwrite(path, data[0, 0, :3].transpose(1, 2, 0), metadata={'axes': 'ZYX'}, photometric='rgb')
    tool.refused(path, 'samples of a pixel X')


def check_pages(tool):
    """Pages that are no slices are left out."""
    path = tool.path('pages.tif')
    data, small = ramp((6, 32, 48), 'u1'), ramp((8, 12), 'u1')
    grey = {'photometric': 'minisblack', 'metadata': None}
    for layout, order in (('a reduced page behind the slices', (0, 1)), ('a reduced page in front of the slices', (1, 0))):
        with tifffile.TiffWriter(path) as file:
            for which in order:
                for page in (data, small[None])[which]:
                    file.write(page, subfiletype=which, **grey)
        tool.layout('TIFF', layout + ' (NewSubfileType 1)', path, data, result='left out')
    with tifffile.TiffWriter(path) as file:
        file.write(small, **grey)
        for page in data:
            file.write(page, **grey)
    tool.layout('TIFF', 'a thumbnail in front that is not marked', path, data, result='left out, with a warning')
    with tifffile.TiffWriter(path) as file:
        for page in (data[0], data[0, :8, :8], data[0, ::2, ::2], data[0, ::4, ::4]):
            file.write(page, compression='zlib', tile=(16, 16), **grey)
    tool.layout('TIFF', 'a pyramid of pages (whole-slide image)', path, data[:1], result='the largest is read, with a warning')
    with tifffile.TiffWriter(path, bigtiff=True) as file:
        file.write(data, subifds=2, tile=(16, 16), **grey)
        for level in (2, 4):
            file.write(data[:, ::level, ::level], subfiletype=1, tile=(16, 16), **grey)
    tool.layout('TIFF', 'a pyramid in SubIFDs', path, data, result='the largest is read')


def check_values(tool):
    """What the numbers mean."""
    path = tool.path('values.tif')
    plain = {'metadata': None, 'software': False}
    mask = ramp((3, 5, 13), 'u1') % 2 == 0
    tifffile.imwrite(path, mask, photometric='minisblack', **plain)
    tool.layout('TIFF', '1 bit, MinIsBlack', path, mask.astype('u1'), type='uint8')
    tifffile.imwrite(path, mask, photometric='miniswhite', **plain)
    tool.layout('TIFF', '1 bit, MinIsWhite', path, 1 - mask.astype('u1'), result='inverted, with a warning', type='uint8')
    tifffile.imwrite(path, mask, photometric='miniswhite')
    tool.layout('TIFF', '1 bit, MinIsWhite, written by tifffile', path, mask.astype('u1'), result='read as written')
    data = ramp((3, 5, 13), 'u2')
    tifffile.imwrite(path, data, photometric='miniswhite', **plain)
    tool.layout('TIFF', '16 bits, MinIsWhite', path, 65535 - data, result='inverted, with a warning', type='uint16')
    colours = (numpy.arange(3 * 256).reshape(3, 256) * 7 % 256).astype('u2')
    indices = ramp((3, 5, 13), 'u1')
    tifffile.imwrite(path, indices, photometric='palette', colormap=colours * 257, **plain)
    for i, name in enumerate(('red', 'green', 'blue')):
        tool.layout('TIFF', 'palette', f'{path}?field={name}', colours[i][indices], result='read as RGB', name=name)
    wide = (colours * 257 + 1).astype('u2')
    tifffile.imwrite(path, indices, photometric='palette', colormap=wide, **plain)
    for i, name in enumerate(('red', 'green', 'blue')):
        tool.layout('TIFF', 'palette with colours of 16 bits', f'{path}?field={name}', wide[i][indices], result='read as RGB', name=name, type='uint16')
    tifffile.imwrite(path, indices, photometric='palette', colormap=colours * 257)
    tool.layout('TIFF', 'palette of ImageJ, OME or tifffile (a lookup table)', path, indices, result='the indices are read')
    missing = ramp((2, 5, 13), 'i2')
    missing[0, 1, 2:5] = -9999
    tifffile.imwrite(path, missing, photometric='minisblack', extratags=[(42113, 2, 6, '-9999', True)], **plain)
    tool.layout('TIFF', 'no-data value of GDAL', path, numpy.where(missing == -9999, numpy.nan, missing.astype('f4')), result='NaN', type='float32')
    for how in ({'predictor': True}, {'predictor': True, 'tile': (16, 16), 'byteorder': '>'}, {'planarconfig': 'separate'}, {'compression': 'lzma'}):
        for dtype in ('u1', 'u2', 'u4', 'f4', 'f8'):
            bands = ramp((2, 3, 32, 48), dtype)
            is_planar = 'planarconfig' in how
            own = {**how, 'predictor': how.get('predictor', False) and not dtype.startswith('f')}  # 3 needs another package
            tifffile.imwrite(path, bands if is_planar else numpy.moveaxis(bands, 1, 3), photometric='rgb', **{'compression': 'zlib', **own, **plain})
            tool.layout('TIFF', 'deflate and LZMA, predictor 2, planes and pixels, strips and tiles', f'{path}?field=blue', bands[:, 2])
    for count in (17, 18):  # of a list of 16 others
        tifffile.imwrite(path, ramp((count, 4, 5), 'u1'), metadata={'axes': 'CYX'}, photometric='minisblack')
        for field in ('', '?field=channel 17'):
            tool.equal(path + field, ramp((count, 4, 5), 'u1')[16:17] if field else ramp((count, 4, 5), 'u1')[:1],
                       warned='more fields than are listed, at most 16' if count == 18 else '')
    many = ramp((7, 32, 48), 'u2')
    tifffile.imwrite(path, many, photometric='minisblack', planarconfig='separate', **plain)
    tool.layout('TIFF', 'more than 4 samples per pixel', f'{path}?field=channel 6', many[5:6], result='fields channel 1, channel 2, …')
    tifffile.imwrite(path, data, photometric='minisblack', volumetric=True, **plain)
    tool.layout_refused('TIFF', 'pages with depth (SGI)', path, 'has depth')
    tifffile.imwrite(path, ramp((2, 5, 13), 'u2'), **plain)
    with tifffile.TiffFile(path, mode='r+b') as file:
        file.pages[0].tags['Compression'].overwrite(7)
        file.pages[0].tags['BitsPerSample'].overwrite(12)
    tool.refused(path, 'JPEG with 12 bits', 'deflate')


def check_place(tool):
    """The places of slices and pixels, and files that give them only in part."""
    path = tool.path('place.tif')
    data = ramp((4, 8, 9), 'u2')
    plain = {'photometric': 'minisblack', 'metadata': None}
    with tifffile.TiffWriter(path) as file:
        for i, page in enumerate(data):
            file.write(page, resolution=(200 if i == 2 else 100, 100), resolutionunit='centimeter', **plain)
    tool.layout('TIFF', 'pages with several resolutions', path, data, spacing=[0.1, 0.1, 0.1], unit='mm', warned='Page 3 has 200 x 100',
                result='that of the first page, with a warning')
    tool.equal(path, data, warned='does not give the distance of its slices; that of columns was taken, 0.1 mm')
    keys = [1, 1, 0, 3, 1024, 0, 1, 1, 1025, 0, 1, 1, 3076, 0, 1, 9001]
    for matrix, place in (([30, 0, 0, 5e5, 0, -20, 0, 4e6] + [0] * 7 + [1], {'spacing': [30, 20, 30], 'origin': [500015, 3999990, 0],
                                                                            'direction': [1, 0, 0, 0, -1, 0, 0, 0, 1]}),
                          ([20, -10, 0, 100, 10, 20, 0, 200] + [0] * 7 + [1], {'spacing': [500 ** 0.5] * 3, 'origin': [105, 215, 0],
                                                                               'direction': [0.8 ** 0.5, -0.2 ** 0.5, 0, 0.2 ** 0.5, 0.8 ** 0.5, 0, 0, 0, 1]}),
                          ([20, 3, 0, 100, 0, -4, 0, 200] + [0] * 7 + [1], {'spacing': [20, 5, 20], 'origin': [111.5, 198, 0],
                                                                            'direction': [1, 0.6, 0, 0, -0.8, 0, 0, 0, 1]})):
        tags = [(34264, 12, 16, tuple(map(float, matrix)), True), (34735, 3, len(keys), keys, True)]
        tifffile.imwrite(path, data[:1], extratags=tags, **plain)
        tool.layout('TIFF', 'GeoTIFF: ModelTransformation', path, data[:1], result='place, spacing and directions', unit='m', **place)
    ties = [float(n) for i, j in ((0, 0), (9, 0), (0, 8), (9, 8)) for n in (i, j, 0, 5e5 + 30 * i + i * j, 4e6 - 30 * j, 0)]
    for tags, layout, warning in (([(33922, 12, len(ties), ties, True)], 'control points', 'The image has 4 control points'),
                                  ([(33550, 12, 3, [0.0, 30.0, 0.0], True)], 'a scale of 0', 'ModelPixelScale'),
                                  ([(34264, 12, 16, [float(i % 5 == 0) for i in range(15)] + [2.0], True)], 'a matrix that is not affine', 'ModelTransformation')):
        tifffile.imwrite(path, data[:1], extratags=[*tags, (34735, 3, len(keys), keys, True)], **plain)
        tool.layout('TIFF', f'GeoTIFF: {layout}', path, data[:1], result='not placed, with a warning', spacing=[1, 1, 1], warned=warning)
    tifffile.imwrite(path, data, extratags=[(274, 3, 1, 2, True)], **plain)
    tool.layout('TIFF', 'the tag Orientation, other than 1', path, data, result='as stored, with a warning', warned='The tag Orientation is 2')
    os.makedirs(tool.path('stack'))
    for k in range(3):
        tifffile.imwrite(tool.path(f'stack/s{k}.tif'), data[k], resolution=(100, 100), resolutionunit='centimeter', **plain)
    tool.layout('TIFF', 'a stack of files without a distance of slices', tool.path('stack'), data[:3], spacing=[0.1, 0.1, 0.1], unit='mm',
                result='that of columns, with a warning', warned='does not give the distance of its slices')
    path = tool.path('place.ome.tif')
    size = {'PhysicalSizeX': 0.2, 'PhysicalSizeXUnit': 'µm', 'PhysicalSizeY': 0.2, 'PhysicalSizeYUnit': 'µm'}
    for own, z, warning in (({'Plane': {'PositionZ': [0.0, 400.0, 800.0, 1200.0], 'PositionZUnit': ['nm'] * 4}}, 0.4, ''),
                            ({'Plane': {'PositionZ': [4.0, 3.5, 3.0, 2.5], 'PositionZUnit': ['µm'] * 4}}, 0.5, ''),
                            ({'Plane': {'PositionZ': [0.0, 1.0, 3.0, 4.0], 'PositionZUnit': ['µm'] * 4}}, 0.2, 'the distance of its slices'),
                            ({'Plane': {'PositionZ': [0.0, 1.0, 2.0, 3.0]}}, 0.2, 'the distance of its slices'),
                            ({'PhysicalSizeZ': -0.5}, 0.2, 'the distance of its slices; that of columns was taken, 0.2 um'),
                            ({'PhysicalSizeZ': 3, 'Plane': {'PositionZ': [0.0, 1.0, 2.0, 3.0], 'PositionZUnit': ['µm'] * 4}}, 3, '')):
        tifffile.imwrite(path, data, metadata={'axes': 'ZYX', **size, **own}, photometric='minisblack')
        tool.layout('TIFF', 'OME-XML without PhysicalSizeZ: PositionZ of planes', path, data, spacing=[0.2, 0.2, z], unit='um', warned=warning,
                    result='the distance of slices, or a warning')
    for axes in ('LYX', 'EYX'):
        path = tool.path('axes.tif')
        tifffile.imwrite(path, data, metadata={'axes': axes}, photometric='minisblack')
        tool.layout('TIFF', 'JSON of tifffile, axes of exposures (L) and wavelengths (E)', f'{path}?field=channel 3', data[2:3], result='channels')
    check_files(tool)


def check_files(tool):
    """OME-XML that names the files of the planes."""
    data = ramp((3, 8, 9), 'u2')
    for is_root, named in ((False, range(3)), (True, range(3)), (False, (1,))):
        ids = [f'urn:uuid:{k:08d}-0000-0000-0000-000000000000' for k in range(3)]
        own = f' UUID="{ids[1]}"' if is_root else ''
        blocks = ''.join(f'<TiffData IFD="0" FirstZ="{i}" PlaneCount="1"><UUID FileName="z{k}.ome.tif">{ids[k]}</UUID></TiffData>' for i, k in enumerate(named))
        text = (f'<?xml version="1.0"?><OME xmlns="http://www.openmicroscopy.org/Schemas/OME/2016-06"{own}><Image ID="Image:0"><Pixels ID="Pixels:0" '
                f'DimensionOrder="XYZCT" Type="uint16" SizeX="9" SizeY="8" SizeZ="{len(named)}" SizeC="1" SizeT="1">'
                f'{blocks}</Pixels></Image></OME>')
        path = tool.path('files.ome.tif')
        tifffile.imwrite(path, data[1], description=text, metadata=None)
        if len(named) > 1:
            tool.layout_refused('TIFF', 'OME-XML of several files', path, 'the planes are in several files, such as z')
        else:
            tool.layout('TIFF', 'OME-XML that names this file by another name', path, data[1:2])


def replace(path, old, new):
    """Changes bytes of a file."""
    with open(path, 'r+b') as file:
        content = file.read()
        file.seek(0)
        file.write(content.replace(old, new))


def lsm(shape, spacing):
    """The beginning of the structure CZ_LSMINFO."""
    t, c, z, y, x = shape
    return struct.pack('<II8i3d', 0x400494c, 500, x, y, z, c, t, 1, 0, 0, *spacing) + bytes(400)


def check_programs(tool):
    """Tags and descriptions of other programs. tifffile reads the same arrays."""
    path = tool.path('program.lsm')
    data = ramp((2, 3, 4, 32, 48), 'u1')  # t, z, c, y, x
    info = lsm((2, 4, 3, 32, 48), (2e-7, 2e-7, 1e-6))
    with tifffile.TiffWriter(path, byteorder='<') as file:
        for i, page in enumerate(data.reshape(-1, 4, 32, 48)):
            tags = [(34412, 7, len(info), info, True)] if i == 0 else None
            file.write(page, photometric='minisblack', planarconfig='separate', metadata=None, extratags=tags)
            file.write(page[:3, ::4, ::4], photometric='rgb', planarconfig='separate', metadata=None, subfiletype=1)
    for step in (0, 1):
        tool.layout('TIFF', 'Zeiss LSM: times, slices, channels, thumbnails', f'{path}?field=channel 2', data[step, :, 1], step=step, steps=2,
                    spacing=[0.2, 0.2, 1], unit='um')
    path = tool.path('program.stk')
    planes = ramp((5, 8, 9), 'u2')
    tags = [(33629, 5, 5, [1, 1] * 5, True)]
    tifffile.imwrite(path, planes, photometric='minisblack', truncate=True, extratags=tags)
    replace(path, b'{"shape"', b'MetaMorp')  # without the description of tifffile
    tool.layout('TIFF', 'MetaMorph STK: a stack behind one directory', path, planes, result='read as slices, with a warning about the spacing')
    path = tool.path('program.tif')
    for layout, how, spacing, unit in (
            ('resolution in inches', {'resolution': (254, 127), 'resolutionunit': 'inch'}, [0.1, 0.2, 0.1], 'mm'),
            ('resolution in centimetres', {'resolution': (100, 50), 'resolutionunit': 'centimeter'}, [0.1, 0.2, 0.1], 'mm'),
            ('resolution without a unit', {'resolution': (100, 50), 'resolutionunit': 'none'}, [1, 1, 1], ''),
            ('resolution 0/0', {'resolution': (999, 999), 'resolutionunit': 'inch'}, [1, 1, 1], ''),
            ('description of Aperio', {'description': 'Aperio Image Library v10\n48x32 |AppMag = 20|MPP = 0.5', 'tile': (16, 16)}, [0.5] * 3, 'um')):
        tifffile.imwrite(path, planes, photometric='minisblack', metadata=None, **how)
        if layout.endswith('0/0'):
            replace(path, struct.pack('<II', 999, 1), bytes(8))
        tool.layout('TIFF', layout, path, planes, result=f'spacing {spacing} {unit}'.strip(), spacing=spacing, unit=unit)
    keys = [1, 1, 0, 3, 1024, 0, 1, 1, 1025, 0, 1, 1, 3076, 0, 1, 9001]
    tags = [(33550, 12, 3, (30.0, 20.0, 0.0), True), (33922, 12, 6, (0.0, 0.0, 0.0, 500000.0, 4000000.0, 0.0), True), (34735, 3, len(keys), keys, True)]
    tifffile.imwrite(path, planes[:1], photometric='minisblack', metadata=None, extratags=tags)
    tool.layout('TIFF', 'GeoTIFF: scale and tie point', path, planes[:1], result='place and spacing, north is up', spacing=[30, 20, 30], unit='m',
                origin=[500015, 3999990, 0], direction=[1, 0, 0, 0, -1, 0, 0, 0, 1])
    tifffile.imwrite(path, planes, imagej=True, truncate=True, metadata={'axes': 'ZYX', 'spacing': 2, 'unit': 'um'}, resolution=(2, 2))
    tool.layout('TIFF', 'ImageJ above 4 GB: one directory for all slices', path, planes, spacing=[0.5, 0.5, 2], unit='um')
    replace(path, b'images=5', b'images=9')
    tool.layout_refused('TIFF', 'ImageJ with a wrong number of images', path, 'ImageJ declares 9 images')


def write_packed(path, array, bits):
    """A page whose samples have fewer than 8 bits, which tifffile does not write."""
    rows = numpy.packbits(numpy.unpackbits(array[..., None], axis=-1)[..., -bits:].reshape(len(array), -1), axis=-1).tobytes()
    tags = [(256, array.shape[1]), (257, len(array)), (258, bits), (259, 1), (262, 1), (273, 8 + 2 + 9 * 12 + 4), (277, 1), (278, len(array)), (279, len(rows))]
    entries = b''.join(struct.pack('<HHII', tag, 4, 1, value) for tag, value in tags)
    with open(path, 'wb') as file:
        file.write(b'II*\0' + struct.pack('<IH', 8, len(tags)) + entries + bytes(4) + rows)


def check_beside(tool):
    """Numbered files beside the opened file are slices if they are like it."""
    def write(name, array, **how):
        tifffile.imwrite(tool.path(name), array, photometric='minisblack', metadata=None, **how)
        return tool.path(name)

    data = ramp((3, 8, 9), 'u1') % 4
    first, _ = write('beside1.tif', data[0]), write('beside2.tif', data[1])
    write('beside3.tif', data[2, :4])
    tool.layout('TIFF', 'numbered files beside it', first, data[:2], result='those like it are slices, with a warning', warned='beside3.tif (9 × 4 px')
    tool.layout('TIFF', 'numbered files beside it, ?as=slice', f'{first}?as=slice', data[:1], result='the file alone', warned='')
    tool.equal(tool.path('beside3.tif'), data[2:, :4], warned='beside1.tif')
    for bits in (2, 4):
        write_packed(tool.path('beside3.tif'), data[2], bits)
        tool.equal(first, data[:2], warned=f'of {bits} bits')
        tool.equal(tool.path('beside3.tif'), data[2:], warned='of 8 bits')
    write('beside3.tif', data[2], resolution=(10, 10), resolutionunit='inch')
    tool.equal(first, data[:2], warned='spacing 2.54 × 2.54 mm')
    multi = write('multi1.tif', data)
    tool.refused(f'{multi}?as=slice', 'not a single slice')


def check(tool):
    check_beside(tool)
    check_ome(tool)
    check_plain(tool)
    check_imagej(tool)
    check_imagej_meaning(tool)
    check_shaped(tool)
    check_pages(tool)
    check_place(tool)
    check_values(tool)
    check_programs(tool)
