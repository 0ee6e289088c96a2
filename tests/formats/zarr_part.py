# SPDX-License-Identifier: Apache-2.0
"""Zarr v2 and v3, plain and OME-Zarr, against zarr-python."""
import json
import os
import warnings

import numcodecs
import numcodecs.zarr3
import numpy
import zarr
from zarr.codecs import BloscCodec, BytesCodec, Crc32cCodec, GzipCodec, ShardingCodec, TransposeCodec, ZstdCodec

from ramp import ramp


def write_v2(tool, name, data, chunks, **how):
    array = zarr.create_array(tool.path(name), shape=data.shape, chunks=chunks, dtype=data.dtype, zarr_format=2, overwrite=True, **how)
    array[...] = data
    return tool.path(name)


def check_v2(tool):
    shape, chunks = (5, 6, 7), (2, 4, 3)
    for dtype in ('|u1', '|i1', '<u2', '>u2', '<i2', '>i4', '<f4', '>f4', '<f8', '>f8', '|b1', '<f2', '>f2'):
        data = ramp(shape, dtype)
        wide = data.astype('f4') if data.dtype.itemsize == 2 and data.dtype.kind == 'f' else data
        tool.equal(write_v2(tool, 'type.zarr', data, chunks, compressors=numcodecs.Zlib()), wide)
    data = ramp(shape, '<u4')
    tool.equal(write_v2(tool, 'u4.zarr', data, chunks), data, type='float64')
    data = ramp(shape, '<i2')
    compressors = [None, numcodecs.GZip(), numcodecs.Zstd()]
    compressors += [numcodecs.Blosc(cname=c, shuffle=s) for c, s in (('lz4', 1), ('lz4hc', 2), ('blosclz', 0), ('zstd', 1), ('zlib', 2))]
    for i, compressor in enumerate(compressors):
        tool.equal(write_v2(tool, 'codec.zarr', data, chunks, compressors=compressor, order='CF'[i % 2]), data)
    for separator in './':
        path = write_v2(tool, 'separator.zarr', data, chunks, chunk_key_encoding={'name': 'v2', 'separator': separator}, fill_value=-7)
        os.remove(os.path.join(path, separator.join('111')))
        holed = data.copy()
        holed[2:4, 4:, 3:6] = -7
        tool.equal(path, holed)
    colours = ramp((4, 5, 6, 3), 'u1')
    path = write_v2(tool, 'rgb.zarr', colours, (2, 5, 3, 3))
    tool.equal(path + '?field=green', colours[..., 1], name='green', other0='red')
    channels = ramp((3, 4, 5, 6), '<u2')
    path = write_v2(tool, 'channels.zarr', channels, (2, 2, 5, 3))
    tool.equal(path + '?field=channel 3', channels[2], name='channel 3')
    tool.equal(write_v2(tool, 'flat.zarr', ramp((5, 6), 'u1'), (2, 4)), ramp((1, 5, 6), 'u1'))
    with warnings.catch_warnings():
        warnings.simplefilter('ignore')  # codecs of numcodecs in v3 are no part of the specification
        check_filters(tool)
    path = write_v2(tool, 'cut.zarr', data.astype('f4'), chunks, compressors=numcodecs.Blosc())
    os.truncate(os.path.join(path, '1.1.1'), 40)
    holed = data.astype('f4')
    holed[2:4, 4:, 3:6] = numpy.nan
    tool.equal(path, holed)


def check_filters(tool):
    """Filters before the compressor, and unusual compressors, in v2 and v3."""
    shape, chunks = (5, 6, 7), (2, 4, 3)
    data, real = ramp(shape, '<i2'), ramp(shape, '<f4') / 8
    cases = [('delta', data, [numcodecs.Delta('<i2')]), ('delta', data, [numcodecs.Delta('<i2', '<i4')]), ('delta', real, [numcodecs.Delta('<f4')]),
             ('delta', ramp(shape, '>i4'), [numcodecs.Delta('>i4')]), ('delta', ramp(shape, 'u1'), [numcodecs.Delta('|u1')]),
             ('shuffle', data, [numcodecs.Shuffle(2)]), ('shuffle', ramp(shape, '<f8'), [numcodecs.Shuffle(8), numcodecs.Zlib()]),
             ('fixedscaleoffset', real, [numcodecs.FixedScaleOffset(offset=3, scale=8, dtype='<f4', astype='<u1')]),
             ('fixedscaleoffset', ramp(shape, '<f8'), [numcodecs.FixedScaleOffset(offset=100, scale=0.5, dtype='<f8', astype='<i2')]),
             ('astype', real, [numcodecs.AsType('<f8', '<f4')]), ('astype', ramp(shape, '<i4'), [numcodecs.AsType('<i2', '<i4')]),
             ('quantize', real, [numcodecs.Quantize(3, '<f4')]), ('bitround', real, [numcodecs.BitRound(10)]),
             ('crc32', data, [numcodecs.CRC32()]), ('adler32', data, [numcodecs.Adler32()])]
    for i, (name, values, filters) in enumerate(cases):
        for order in 'CF':
            path = write_v2(tool, 'filter.zarr', values, chunks, filters=filters, compressors=numcodecs.Zlib() if i % 2 else None, order=order)
            tool.layout('Zarr', f'the filter {name}', path, zarr.open_array(path, mode='r')[...])
    for name, compressor in (('LZ4', numcodecs.LZ4()), ('bzip2', numcodecs.BZ2()), ('LZMA (xz)', numcodecs.LZMA())):
        path = write_v2(tool, 'codec.zarr', data, chunks, compressors=compressor)
        tool.layout('Zarr', f'compression {name}', path, data)
        for key in ('0.0.0', '1.1.1'):
            os.truncate(os.path.join(path, key), 12)
        holed = numpy.where(numpy.arange(5)[:, None, None] >= 0, data, 0)
        holed[:2, :4, :3] = holed[2:4, 4:, 3:6] = 0
        tool.equal(path, holed)
    path = write_v2(tool, 'packbits.zarr', data > 100, chunks, filters=[numcodecs.PackBits()])
    tool.layout_refused('Zarr', 'other filters', path, 'is not supported here; write the array with', 'packbits', '/filters')
    path = write_v2(tool, 'lzma.zarr', data, chunks, compressors=numcodecs.LZMA(format=2))
    tool.refused(path, '/compressor/id', 'settings', 'lzma')
    path = tool.path('filter3.zarr')
    for values, filters in ((data, [numcodecs.zarr3.Delta(dtype='<i2')]), (real, [numcodecs.zarr3.FixedScaleOffset(offset=3, scale=8, dtype='<f4', astype='<i2'),
                                                                              numcodecs.zarr3.Delta(dtype='<i2')])):
        array = zarr.create_array(path, shape=shape, chunks=chunks, dtype=values.dtype, filters=filters, compressors=[numcodecs.zarr3.LZ4()], overwrite=True)
        array[...] = values
        tool.layout('Zarr', 'filters of numcodecs in v3', path, array[...])


def check_v3(tool):
    shape = (5, 6, 7)
    serializers = [BytesCodec(endian='little'), BytesCodec(endian='big')]
    compressors = [(), (ZstdCodec(),), (GzipCodec(),), (BloscCodec(cname='zstd'),), (ZstdCodec(checksum=True), Crc32cCodec())]
    for i, packed in enumerate(compressors):
        for dtype, serializer in (('int16', serializers[0]), ('float16', serializers[1])):
            path = tool.path('v3.zarr')
            filters = (TransposeCodec(order=(1, 2, 0)), TransposeCodec(order=(0, 2, 1)))[:i % 3]
            zarr.create_array(path, shape=shape, chunks=(2, 4, 3), dtype=dtype, overwrite=True, filters=filters, serializer=serializer,
                              compressors=packed)[...] = ramp(shape, dtype)
            tool.equal(path, ramp(shape, dtype))
    data = ramp((9, 10, 11), 'uint16')
    for location in ('start', 'end'):
        path = tool.path('shards.zarr')
        sharding = ShardingCodec(chunk_shape=(2, 3, 2), index_location=location, codecs=[BytesCodec(), ZstdCodec()])
        array = zarr.create_array(path, shape=data.shape, chunks=(4, 6, 4), dtype=data.dtype, overwrite=True, serializer=sharding, compressors=None,
                                  filters=None, fill_value=9)
        array[...] = data
        array[2:4, 3:6, 2:4] = 9  # an inner chunk that is missing
        tool.equal(path, array[...])
    path = tool.path('nan.zarr')
    zarr.create_array(path, shape=shape, chunks=shape, dtype='float64', fill_value=numpy.nan, overwrite=True)
    tool.equal(path, numpy.full(shape, numpy.nan))
    group = zarr.open_group(tool.path('group.zarr'), mode='w')
    for name in ('b', 'a'):
        group.create_array(name, data=ramp(shape, 'uint8') + ord(name))
    tool.equal(tool.path('group.zarr'), ramp(shape, 'uint8') + ord('a'), name='a', other0='b')
    tool.equal(tool.path('group.zarr?field=b'), ramp(shape, 'uint8') + ord('b'), name='b')


def ome(version, levels):
    axes = [{'name': 't', 'type': 'time', 'unit': 'second'}, {'name': 'c', 'type': 'channel'}] + \
           [{'name': n, 'type': 'space', 'unit': u} for n, u in (('z', 'nanometer'), ('y', 'micrometer'), ('x', 'micrometer'))]
    datasets = [{'path': f's{i}', 'coordinateTransformations': [
        {'type': 'scale', 'scale': [2, 1, 2000, 0.5 * 2 ** i, 0.5 * 2 ** i]},
        {'type': 'translation', 'translation': [3, 0, 1000, 0.25 * i, 0.25 * i]}]} for i in range(levels)]
    content = {'multiscales': [{'axes': axes, 'datasets': datasets, 'version': version,
                                'coordinateTransformations': [{'type': 'scale', 'scale': [1, 1, 1, 2, 2]}]}],
               'omero': {'channels': [{'label': 'DAPI'}, {'label': 'GFP'}]}}
    return {'ome': {**content, 'version': version}} if version == '0.5' else content


def check_turned(tool):
    """A negative scale: the samples stay, the axis falls."""
    axes = [{'name': n, 'type': 'space', 'unit': 'micrometer'} for n in 'zyx']
    steps = [{'type': 'scale', 'scale': [-2, 1, 0.5]}, {'type': 'translation', 'translation': [10, 0, 3]}]
    group = zarr.open_group(tool.path('turned.zarr'), mode='w', attributes={'ome': {'version': '0.5', 'multiscales': [
        {'axes': axes, 'datasets': [{'path': '0', 'coordinateTransformations': steps}]}]}})
    group.create_array('0', data=ramp((3, 4, 5), 'u1'))
    tool.layout('Zarr', 'a negative scale of OME-Zarr', tool.path('turned.zarr'), ramp((3, 4, 5), 'u1'), spacing=[0.5, 1, 2], origin=[3, 0, 10],
                direction=[1, 0, 0, 0, 1, 0, 0, 0, -1])
    tool.refused(tool.path('turned.zarr?field=red'), 'there is no channel red', 'without a name')


def check_ome(tool):
    for version, zarr_format in (('0.4', 2), ('0.5', 3)):
        path = tool.path(f'image{version}.ome.zarr')
        group = zarr.open_group(path, mode='w', zarr_format=zarr_format, attributes=ome(version, 3))
        levels = [ramp((2, 2, 4, 16 >> i, 12 >> i), 'uint16') + i for i in range(3)]
        for i, level in enumerate(levels):
            group.create_array(f's{i}', shape=level.shape, dtype=level.dtype, chunks=(1, 1, 2, 4, 4))[...] = level
        group.create_group('labels')
        tool.equal(path, levels[0][0, 0], name='DAPI', other0='GFP', unit='um', spacing=[1, 1, 2], origin=[0, 0, 1])
        tool.equal(path + '?level=1&field=GFP', levels[1][0, 1], name='GFP', spacing=[2, 2, 2], origin=[0.5, 0.5, 1])
        tool.equal(path, levels[0][1, 0], step=1, steps=2, times=[3, 5], time_unit='s')
        tool.equal(os.path.join(path, 's2'), levels[2][0, 0], name='DAPI')
        tool.refused(path + '?level=3', 'no level 3', 'to 2')
    check_turned(tool)
    old = zarr.open_group(tool.path('old.zarr'), mode='w', zarr_format=2, attributes={'multiscales': [{'version': '0.1', 'datasets': [{'path': '0'}]}]})
    old.create_array('0', data=ramp((1, 2, 3, 4, 5), 'u2'))
    tool.equal(tool.path('old.zarr?field=channel 2'), ramp((1, 2, 3, 4, 5), 'u2')[0, 1])
    sample = tool.sample('zarr', 'ome_zarr_image-03.zarr')
    if sample:
        tool.equal(sample, zarr.open_array(os.path.join(sample, '0'), mode='r')[...], spacing=[1, 1, 1], unit='um')
    sample = tool.sample('zarr', 'v2_3d.chunked.i2')
    if sample:
        tool.equal(sample, zarr.open_array(sample, mode='r')[...])
    plate = tool.path('plate.zarr')
    os.makedirs(plate)
    for name, content in (('.zgroup', {'zarr_format': 2}), ('.zattrs', {'plate': {}})):
        with open(os.path.join(plate, name), 'w', encoding='utf-8') as file:
            json.dump(content, file)
    tool.refused(plate, 'plate', 'A/1/0')


def check(tool):
    check_v2(tool)
    check_v3(tool)
    check_ome(tool)
