# SPDX-License-Identifier: Apache-2.0
"""HDF5 against h5py, NetCDF against netCDF4."""
import os

import h5py
import netCDF4
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
    tool.refused(path, '/packed/gzip (5 x 6 x 7)', 'choose one')
    tool.refused(f'{path}:/lzf', 'LZF', 'gzip')
    tool.refused(f'{path}:/text', 'no numbers')
    tool.refused(f'{path}:/nothing', 'no such array')
    with h5py.File(tool.path('one.h5'), 'w') as file:
        file['deep/one'] = ramp(SHAPE, 'f4')
        file['list'] = [1, 2, 3]
    os.rename(tool.path('one.h5'), tool.path('one.dat'))  # recognized by its content
    tool.equal(tool.path('one.dat'), ramp(SHAPE, 'f4'), name='/deep/one')
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


def check(tool):
    check_hdf5(tool)
    check_netcdf(tool)
