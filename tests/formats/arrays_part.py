# SPDX-License-Identifier: Apache-2.0
"""HDF5 against h5py, NetCDF against netCDF4."""
import os

import h5py
import netCDF4
import numcodecs
import numpy

from ramp import ramp

SHAPE = (5, 6, 7)


def check_hdf5(tool):
    path = tool.path('a.h5')
    kinds = {}
    for dtype in ('u1', 'i1', '<u2', '>u2', '<i2', '>i4', '<f4', '>f4', '<f8', '>f8', '<f2'):
        kinds[f'plain/{dtype}'] = ramp(SHAPE, dtype)
    with h5py.File(path, 'w') as file:
        for name, data in kinds.items():
            file[name] = data
        data = ramp(SHAPE, '<i2')
        for name, how in {'gzip': {'compression': 'gzip'}, 'shuffle': {'compression': 'gzip', 'shuffle': True}, 'sum': {'fletcher32': True},
                          'plain': {}}.items():
            file.create_dataset(f'packed/{name}', data=data, chunks=(2, 4, 3), **how)
        file.create_dataset('lzf', data=data, compression='lzf')
        file['wide'] = ramp(SHAPE, 'u4')
        file['series'] = ramp((3, 2, 4, 5, 6), 'u1')
        file['rgb'] = ramp((4, 5, 6, 3), 'u1')
        file['text'] = 'words'
        file['mask'] = ramp(SHAPE, 'u1') > 100
        file['table'] = numpy.zeros(4, dtype=[('a', 'i4'), ('b', 'f4')])
        file['outside'] = h5py.ExternalLink('/etc/passwd', '/x')
        file['virtual'] = data
        file['size'] = data
        file['size'].attrs['element_size_um'] = [3.0, 2.0, 0.5]
    for name, data in kinds.items():
        wide = data.astype('f4') if data.dtype == '<f2' else data
        tool.equal(f'{path}:/{name}', wide, name=f'/{name}')
    for name in ('gzip', 'shuffle', 'sum', 'plain'):
        tool.equal(f'{path}?field=packed/{name}', ramp(SHAPE, '<i2'))
    tool.equal(f'{path}:/wide', ramp(SHAPE, 'u4'), type='float64')
    tool.equal(f'{path}:/series 2', ramp((3, 2, 4, 5, 6), 'u1')[1, 1], step=1, steps=3)
    tool.equal(f'{path}:/rgb 3', ramp((4, 5, 6, 3), 'u1')[..., 2])
    tool.equal(f'{path}:/size', ramp(SHAPE, '<i2'), spacing=[0.5, 2, 3], unit='um')
    tool.equal(f'{path}:/mask', ramp(SHAPE, 'u1') > 100)
    tool.refused(path, '/plain/<i2 (5 x 6 x 7)', 'choose one')
    tool.refused(f'{path}:/text', 'no numbers')
    tool.refused(f'{path}:/nothing', 'no such array')
    tool.refused(f'{path}:/size?as=time', 'there is no such file; in a source with choices', '?as=time&field=/NAME')
    with h5py.File(tool.path('one.h5'), 'w') as file:
        file['deep/one'] = ramp(SHAPE, 'f4')
        file['list'] = [1, 2, 3]
    os.rename(tool.path('one.h5'), tool.path('one.dat'))  # recognized by its content
    tool.equal(tool.path('one.dat'), ramp(SHAPE, 'f4'), name='/deep/one')
    with h5py.File(tool.path('image.vtkhdf'), 'w') as file:
        file.create_group('VTKHDF').attrs['Type'] = numpy.bytes_('ImageData')
        file['VTKHDF/PointData/s'] = ramp(SHAPE, 'f4')
    tool.refused(tool.path('image.vtkhdf'), 'VTKHDF', '.vti')
    with h5py.File(tool.path('chunk.h5'), 'w') as file:  # never written, so the file is small
        file.create_dataset('d', (80, 1024, 1024), 'f4', chunks=(80, 1024, 1024), compression='gzip')
    tool.refused(tool.path('chunk.h5'), 'a chunk has more than 256 MiB', 'h5repack')
    with netCDF4.Dataset(tool.path('chunk.nc'), 'w') as file:
        for axis, size in zip('zyx', (80, 1024, 1024)):
            file.createDimension(axis, size)
        file.createVariable('v', 'f4', tuple('zyx'), zlib=True, chunksizes=(80, 1024, 1024))
    tool.refused(tool.path('chunk.nc'), 'a chunk has more than 256 MiB')
    tool.refused(f"{tool.path('image.vtkhdf')}:/VTKHDF/PointData/s", 'VTKHDF')
    os.truncate(path, os.path.getsize(path) // 2)
    tool.refused(path, 'HDF5 cannot open')


def write_netcdf(path, kind):
    with netCDF4.Dataset(path, 'w', format=kind) as file:
        for name, values, unit in (('time', [0, 6, 12], 'hours since 2000-01-01'), ('height', [10, 20, 50, 100], 'm'),
                                   ('y', [300, 200, 100, 0, -100], 'km'), ('x', numpy.arange(6) * 0.1, 'km')):
            file.createDimension(name, len(values))
            file.createVariable(name, 'f8', (name,))[:] = values
            file[name].units = unit
        packed = file.createVariable('packed', 'i2', ('time', 'height', 'y', 'x'), fill_value=-1)
        packed.scale_factor, packed.add_offset, packed.units = 0.5, 100.0, 'K'
        packed.set_auto_maskandscale(False)
        values = ramp((3, 4, 5, 6), 'i2')
        values[1, 2, 3, 4] = -1
        packed[:] = values
        file.createVariable('real', 'f4', ('height', 'y', 'x'))[:] = ramp((4, 5, 6), 'f4')
        file.createVariable('turned', 'f8', ('x', 'height', 'y'))[:] = ramp((6, 4, 5), 'f8')
    return values


def check_netcdf(tool):
    for kind in ('NETCDF3_CLASSIC', 'NETCDF3_64BIT_OFFSET', 'NETCDF3_64BIT_DATA', 'NETCDF4', 'NETCDF4_CLASSIC'):
        path = tool.path(f'{kind}.nc')
        values = write_netcdf(path, kind)
        expected = values.astype('f4') * 0.5 + 100
        expected[values == -1] = numpy.nan
        place = {'unit': 'km', 'origin': [0, 300, 0.01], 'coordinates2': [0, 0.01, 0.04, 0.09], 'direction': [1, 0, 0, 0, -1, 0, 0, 0, 1]}
        for step in (0, 1):
            tool.equal(path, expected[step], step=step, steps=3, times=[0, 6, 12], time_unit='h', name='packed', other0='real', value_unit='K', **place)
        tool.equal(f'{path}:/real', ramp((4, 5, 6), 'f4'), **place)
        tool.equal(f'{path}?field=turned', ramp((6, 4, 5), 'f8').transpose(1, 2, 0), **place)
    sample = tool.sample('netcdf', 'eraint_uvz.nc')
    if sample:
        with netCDF4.Dataset(sample) as file:
            for name in ('z', 'u', 'v'):
                variable = file[name]
                variable.set_auto_maskandscale(False)
                expected = variable[1].astype('f8') * variable.scale_factor + variable.add_offset
                tool.equal(f'{sample}:/{name}', expected.astype('f4'), step=1, steps=2, origin=[-180, 90, -27.6346153846], spacing=[0.75, 0.75, 44.90625],
                           unit='degrees')
    cut = tool.path('cut.nc')
    with open(tool.path('NETCDF3_CLASSIC.nc'), 'rb') as file, open(cut, 'wb') as out:
        out.write(file.read()[:-2])
    tool.refused(cut, 'cut off')


def check_hdf5_layouts(tool):
    """Filters, names of axes, and what is no volume."""
    path = tool.path('layouts.h5')
    data = ramp((6, 8, 10), '<i2')
    with h5py.File(path, 'w') as file:
        file.create_dataset('lzf', data=data, chunks=(2, 8, 5), compression='lzf', shuffle=True)
        for name, code, codec, settings in (('zstd', 32015, numcodecs.Zstd(), (3,)), ('blosc', 32001, numcodecs.Blosc(), (2, 2, 2, 480, 5, 1, 0)),
                                            ('lz4', 32004, None, ())):
            how = h5py.h5p.create(h5py.h5p.DATASET_CREATE)
            how.set_chunk((3, 8, 10))
            how.set_filter(code, h5py.h5z.FLAG_OPTIONAL, settings)
            own = h5py.h5d.create(file.id, name.encode(), h5py.h5t.STD_I16LE, h5py.h5s.create_simple(data.shape), how)
            for k in (0, 3):
                packed = codec.encode(data[k:k + 3]) if codec else data[k:k + 3].tobytes()
                own.write_direct_chunk((k, 0, 0), bytes(packed))
        for name, code, frame in (('short zstd', 32015, numcodecs.Zstd().encode(bytes(40))), ('short blosc', 32001, numcodecs.Blosc().encode(bytes(40))),
                                  ('short lzf', 32000, b'\x1f' + bytes(32))):
            how = h5py.h5p.create(h5py.h5p.DATASET_CREATE)
            how.set_chunk(data.shape)
            how.set_filter(code, h5py.h5z.FLAG_OPTIONAL, (4, 261, 32) if code == 32000 else ())
            own = h5py.h5d.create(file.id, name.encode(), h5py.h5t.STD_I16LE, h5py.h5s.create_simple(data.shape), how)
            own.write_direct_chunk((0, 0, 0), bytes(frame))
        labelled = file.create_dataset('labelled', data=data)
        for i, name in enumerate('xyz'):
            labelled.dims[i].label = name
        file['empty'] = numpy.zeros((0, 8, 10))
        file['line'] = numpy.arange(7.0)
        file['text'] = ['a', 'b']
        file['table'] = numpy.zeros(4, dtype=[('a', 'i4'), ('b', 'f4'), ('c', 'f4')])
        file['big'] = data.astype('>u4')
        file['bits'] = data.astype('u1')
    for name, how in (('lzf', 'LZF (h5py)'), ('zstd', 'Zstandard'), ('blosc', 'Blosc')):
        tool.layout('HDF5', f'compression {how}', f'{path}:/{name}', data)
    tool.layout_refused('HDF5', 'compression LZ4, bzip2, bitshuffle, ZFP, Blosc2', f'{path}:/lz4', 'the compression LZ4 (filter 32004) is not supported',
                        'h5repack')
    for name in ('zstd', 'blosc', 'lzf'):
        tool.refused(f'{path}:/short {name}', 'cannot read')
    tool.layout('HDF5', 'labels of dimensions (x, y, z)', f'{path}:/labelled', data.transpose(2, 1, 0))
    tool.layout_refused('HDF5', 'text', f'{path}:/text', 'it has no numbers but text')
    tool.layout_refused('HDF5', 'a table', f'{path}:/table', 'it has no numbers but rows of the columns a, b, c')
    tool.layout_refused('HDF5', 'an array of length 0', f'{path}:/empty', 'dimension 0 has the length 0')
    tool.layout('HDF5', 'one dimension', f'{path}:/line', numpy.arange(7.0)[None, None])
    path = tool.path('lines.h5')
    with h5py.File(path, 'w') as file:
        file['group/plane'], file['group/line'], file['group/none'] = ramp((5, 6), 'u1'), numpy.arange(3), numpy.zeros((0, 3, 4))
    tool.layout('HDF5', 'a plane in a group, beside smaller arrays', path, ramp((1, 5, 6), 'u1'), name='/group/plane')


def check_hdf5_unreadable(tool):
    """Arrays that cannot be read: the reader never shows another array in their place without a message."""
    data = ramp((6, 8, 10), '<i2')
    path = tool.path('unreadable.h5')
    how = h5py.h5p.create(h5py.h5p.DATASET_CREATE)
    how.set_chunk((3, 8, 10))
    how.set_filter(32008, h5py.h5z.FLAG_OPTIONAL, ())
    with h5py.File(path, 'w') as file:
        h5py.h5d.create(file.id, b'data', h5py.h5t.STD_I16LE, h5py.h5s.create_simple(data.shape), how)
        file['mask'] = ramp((8, 10), 'u1')
        file['later'] = h5py.ExternalLink('packed_data.h5', '/data')
    tool.layout_refused('HDF5', 'one array of three dimensions, with an unknown compression, beside a plane', path, 'the array cannot be read',
                        'unreadable.h5: /data', 'bitshuffle (filter 32008)', 'as h5repack -f GZIP=4 does; ?field=NAME reads another array')
    tool.equal(f'{path}?field=mask', ramp((1, 8, 10), 'u1'), warned='')
    with h5py.File(path, 'r+') as file:
        file['third'] = data
    tool.refused(path, 'choose one', '/data (6 x 8 x 10, cannot be read)', '/third (6 x 8 x 10)')
    with h5py.File(path, 'r+') as file:
        del file['data']
    tool.layout('HDF5', 'an external link beside an array', path, data, warned='/later was left out: it is a link to /data in the file packed_data.h5',
                result='read; a warning names the link')


def check_netcdf_layouts(tool):
    """Groups, conventions about numbers, and axes."""
    path = tool.path('groups.nc')
    data = ramp((3, 4, 5), 'f4')
    with netCDF4.Dataset(path, 'w') as file:
        file.createDimension('time', None)
        for name, values in (('z', [3, 2, 1]), ('y', [10, 20, 30, 40]), ('x', [0, 5, 10, 15, 20])):
            file.createDimension(name, len(values))
            file.createVariable(name, 'f4', (name,))[:] = values
        inner = file.createGroup('forecast/model')
        inner.createVariable('wind', 'f4', ('z', 'y', 'x'))[:] = data
        other = file.createGroup('other')
        other.createDimension('x', 2)
        other.createVariable('x', 'f8', ('x',))[:] = [1, 3]
        other.createVariable('line', 'f4', ('z', 'y', 'x'))[:] = data[..., :2]
        other.createVariable('empty', 'f4', ('time', 'y', 'x'))
    tool.layout('NetCDF', 'an array in a group; coordinates of the group above, which fall', path, data, name='forecast/model/wind', origin=[0, 10, 3],
                spacing=[5, 10, 1], direction=[1, 0, 0, 0, 1, 0, 0, 0, -1], other0='other/line')
    tool.layout('NetCDF', 'coordinates of the same group', f'{path}:/other/line', data[..., :2], origin=[1, 10, 3], spacing=[2, 10, 1])
    tool.layout_refused('NetCDF', 'a dimension of length 0', f'{path}?field=other/empty', 'has the length 0')
    path = tool.path('numbers.nc')
    with netCDF4.Dataset(path, 'w') as file:
        file.set_auto_maskandscale(False)
        for name, size in (('nv', 2), ('z', 2), ('y', 3), ('x', 4)):
            file.createDimension(name, size)
        file.createVariable('y_bnds', 'f8', ('y', 'nv'))[:] = ramp((3, 2), 'f8')
        values = ramp((2, 3, 4), 'i2')
        tenths = (numpy.arange(24).reshape(2, 3, 4) / 10).astype('f4')
        for name, kind, attributes in (('ranged', 'i2', {'valid_range': numpy.array([20, 200], 'i2')}),
                                       ('least', 'f4', {'valid_min': numpy.float32(50)}),
                                       ('tenths', 'f4', {'valid_range': numpy.array([0.1, 2.3])}),
                                       ('missing', 'i4', {'missing_value': numpy.array([11, 48], 'i4'), 'scale_factor': 2.0}),
                                       ('unsigned', 'i1', {'_Unsigned': 'true'}),
                                       ('bytes', 'i1', {'_Unsigned': 'true', 'scale_factor': 0.5, 'add_offset': 1.0})):
            variable = file.createVariable(name, kind, ('z', 'y', 'x'), fill_value=-5 if name == 'bytes' else None)
            variable.set_auto_maskandscale(False)
            variable.setncatts(attributes)
            variable[:] = values.astype('u1').view('i1') if kind == 'i1' else tenths if name == 'tenths' else values
        file.createVariable('words', str, ('z',))[:] = numpy.array(['a', 'b'], object)
        switch = file.createEnumType('u1', 'switch', {'off': 0, 'on': 1})
        file.createVariable('state', switch, ('z', 'y', 'x'))[:] = values % 2
        signed = file.createVariable('signed', 'u1', ('z', 'y', 'x'), fill_value=255)
        signed.set_auto_maskandscale(False)
        signed.setncatts({'_Unsigned': 'false', 'valid_min': numpy.uint8(156)})
        signed[:] = values.astype('u1')
        for kind in ('i1', 'u1', 'i2', 'u2', 'i4', 'f4', 'i8'):
            holed = file.createVariable(f'holed_{kind}', kind, ('z', 'y', 'x'))
            holed.set_auto_maskandscale(False)
            holed[0] = values[0] % 100
        turned = file.createVariable('holed_turned', 'i8', ('z', 'y', 'x'))
        turned.set_auto_maskandscale(False)
        turned.setncattr('_Unsigned', 'true')
        turned[0] = values[0]
        file.createVariable('never', 'i2', ('z', 'y', 'x'), fill_value=False)[:] = numpy.where(values == 11, -32767, values)
        packed = file.createVariable('holed_packed', 'i2', ('z', 'y', 'x'))
        packed.set_auto_maskandscale(False)
        packed.scale_factor = 0.5
        packed[0] = values[0]
    wide = values.astype('f4')
    bytes_of = values.astype('u1').view('i1').astype('f4')
    tool.layout('NetCDF', '_Unsigned = "false" of unsigned bytes, with their _FillValue and valid_min', f'{path}:/signed',
                numpy.where((bytes_of == -1) | (bytes_of < -100), numpy.nan, bytes_of), type='float32')
    for kind in ('i1', 'u1', 'i2', 'u2', 'i4', 'f4', 'i8'):
        default = netCDF4.default_fillvals[kind]
        holed = numpy.where(numpy.arange(2)[:, None, None] == 0, values % 100, numpy.nan if kind[1] != '1' else default)
        tool.layout('NetCDF', 'numbers that no program wrote, without _FillValue, of 16 bits and more', f'{path}:/holed_{kind}', holed, result='NaN')
    tool.equal(f'{path}:/holed_turned', numpy.where(numpy.arange(2)[:, None, None] == 0, values, numpy.nan))
    tool.layout('NetCDF', 'an array without fill values (nofill)', f'{path}:/never', numpy.where(values == 11, -32767, values), type='int16')
    tool.equal(f'{path}:/holed_packed', numpy.where(numpy.arange(2)[:, None, None] == 0, wide * 0.5, numpy.nan))
    tool.layout('NetCDF', 'valid_range', f'{path}:/ranged', numpy.where((wide < 20) | (wide > 200), numpy.nan, wide), result='NaN outside of it')
    tool.layout('NetCDF', 'valid_min, valid_max', f'{path}:/least', numpy.where(wide < 50, numpy.nan, wide), result='NaN outside of them')
    tool.equal(f'{path}:/tenths', numpy.where(tenths == 0, numpy.nan, tenths))
    tool.layout('NetCDF', 'missing_value with several values, scale_factor', f'{path}:/missing',
                numpy.where((wide == 11) | (wide == 48), numpy.nan, wide * 2).astype('f8'), result='NaN', type='float64')
    tool.layout('NetCDF', '_Unsigned', f'{path}:/unsigned', values.astype('u1'), type='uint8')
    tool.layout('NetCDF', '_Unsigned, _FillValue, scale_factor and add_offset', f'{path}:/bytes', numpy.where(values == 251, numpy.nan, wide * 0.5 + 1))
    tool.layout('NetCDF', 'names of numbers (enum)', f'{path}:/state', (values % 2).astype('u1'), type='uint8')
    tool.layout_refused('NetCDF', 'text', f'{path}:/words', 'it has no numbers but text')


def check(tool):
    check_hdf5(tool)
    check_netcdf(tool)
    check_hdf5_layouts(tool)
    check_hdf5_unreadable(tool)
    check_netcdf_layouts(tool)
