# SPDX-License-Identifier: Apache-2.0
"""The conventions of CF in Zarr (as xarray writes it), HDF5 and NetCDF: one set of cases for all of them."""
import base64
import json
import os
import struct

import h5py
import netCDF4
import numpy
import zarr

from ramp import ramp

SHAPE = (3, 4, 5, 6)
AXES = {'time': ([0, 6, 12], {'units': 'hours since 2000-01-01'}), 'height': ([10, 20, 50, 100], {'units': 'm', 'axis': 'Z'}),
        'y': ([300, 200, 100, 0, -100], {'units': 'km'}), 'x': (numpy.arange(6) * 0.1, {'units': 'km'})}


def arrays_of():
    """Names: (dimensions, numbers, attributes, _FillValue)."""
    packed = ramp(SHAPE, 'i2')
    packed[1, 2, 3, 4] = -1
    how = {'scale_factor': 0.5, 'add_offset': 100.0, 'units': 'K', 'long_name': 'temperature', 'coordinates': 'aux'}
    ranged = {'valid_range': numpy.array([20, 200], 'i2')}
    arrays = {name: ((name,), numpy.asarray(values, 'f8'), attributes, None) for name, (values, attributes) in AXES.items()}
    arrays['aux'] = (('time', 'height', 'y', 'x'), ramp(SHAPE, 'f4'), {}, None)
    arrays['packed'] = (tuple(AXES), packed, how, -1)
    arrays['ranged'] = (('height', 'y', 'x'), ramp(SHAPE[1:], 'i2'), ranged, None)
    arrays['turned'] = (('x', 'height', 'y'), ramp((6, 4, 5), 'f8'), {'missing_value': ramp((6, 4, 5), 'f8')[1, 2, 3]}, None)
    arrays['zero'] = (('y', 'x'), ramp((5, 6), 'u1') % 3, {'scale_factor': 2.0}, 0)
    return arrays


def plain(value):
    return value.tolist() if hasattr(value, 'tolist') else value


def write_zarr(tool, version):
    """Writes the arrays as xarray does: _FillValue is the fill value in v2, and base64 of a float64 in v3."""
    path = tool.path(f'cf{version}.zarr')
    group = zarr.open_group(path, mode='w', zarr_format=version)
    for name, (dims, data, attributes, fill) in arrays_of().items():
        attributes = {key: plain(value) for key, value in attributes.items()}
        how = {'chunks': tuple(max(1, n - 1) for n in data.shape)}
        if version == 2:
            attributes['_ARRAY_DIMENSIONS'] = list(dims)
            how['fill_value'] = fill
        else:
            how['dimension_names'] = dims
            if fill is not None:
                attributes['_FillValue'] = fill
        array = group.create_array(name, shape=data.shape, dtype=data.dtype, attributes=attributes, **how)
        array[...] = data
    return path


def write_netcdf(path, engine):
    if engine == 'netCDF4':
        with netCDF4.Dataset(path, 'w') as file:
            for name, (dims, data, attributes, fill) in arrays_of().items():
                if name in AXES:
                    file.createDimension(name, len(data))
                variable = file.createVariable(name, data.dtype, dims, fill_value=fill)
                variable.set_auto_maskandscale(False)
                variable.setncatts(attributes)
                variable[:] = data
        return
    with h5py.File(path, 'w') as file:
        for name, (dims, data, attributes, fill) in arrays_of().items():
            array = file.create_dataset(name, data=data)
            array.attrs.update(attributes)
            if fill is not None:
                array.attrs['_FillValue'] = numpy.array([fill], data.dtype)
            if name in AXES:
                array.make_scale(name)
            else:
                for d, own in enumerate(dims):
                    array.dims[d].attach_scale(file[own])


def check_all(tool, form, path, first):
    arrays = arrays_of()
    packed = arrays['packed'][1]
    expected = packed.astype('f4') * 0.5 + 100
    expected[packed == -1] = numpy.nan
    place = {'unit': 'km', 'origin': [0, 300, 0.01], 'coordinates2': [0, 0.01, 0.04, 0.09], 'direction': [1, 0, 0, 0, -1, 0, 0, 0, 1]}
    source = path if first else path + '?field=packed'
    for step in (0, 1):
        tool.layout(form, 'scale_factor, add_offset, _FillValue, units; coordinates even, uneven and falling', source, expected[step], step=step, steps=3,
                    times=[0, 6, 12], time_unit='h', value_unit='K', **place)
    ranged = arrays['ranged'][1].astype('f4')
    tool.equal(path + '?field=ranged', numpy.where((ranged < 20) | (ranged > 200), numpy.nan, ranged), **place)
    turned = arrays['turned'][1].copy()
    turned[turned == turned[1, 2, 3]] = numpy.nan
    tool.layout(form, 'dimensions in another order, missing_value', path + '?field=turned', turned.transpose(1, 2, 0), **place)
    zero = arrays['zero'][1].astype('f4')[None]
    tool.equal(path + '?field=zero', numpy.where(zero == 0, numpy.nan, zero * 2))


def check(tool):
    for version in (2, 3):
        check_all(tool, 'Zarr', write_zarr(tool, version), True)
    for engine, name in (('netCDF4', 'cf.nc'), ('netCDF4', 'cf4.h5'), ('h5py', 'cf.h5'), ('h5py', 'cfh.nc')):
        write_netcdf(tool.path(name), engine)
        check_all(tool, 'NetCDF' if name.endswith('nc') else 'HDF5', tool.path(name), name.endswith('nc'))
    check_zarr(tool)
    check_tags(tool)
    check_vectors(tool)
    check_kinds(tool)
    check_sizes(tool)


def check_vectors(tool):
    """Three numbers per voxel as vectors: their lengths and components."""
    data = ramp((4, 5, 6, 3), 'i2') - 100
    first = numpy.ascontiguousarray(numpy.moveaxis(data, -1, 0))
    with h5py.File(tool.path('vectors.h5'), 'w') as file:
        file['flow'], file['other'] = first, data[..., 0]
        file['last'] = data
        file['last'].attrs['axistags'] = tags('zyxc')
    with netCDF4.Dataset(tool.path('vectors.nc'), 'w') as file:
        for name, size in zip(('z', 'y', 'x', 'component'), data.shape):
            file.createDimension(name, size)
        file.createVariable('last', 'i2', ('z', 'y', 'x', 'component'))[:] = data
    group = zarr.open_group(tool.path('vectors.zarr'), mode='w')
    group.create_array('last', shape=data.shape, dtype='i2', chunks=(3, 2, 4, 2), dimension_names=('z', 'y', 'x', 'component'))[...] = data
    zarr.create_array(tool.path('flow.zarr'), shape=first.shape, dtype='i2', chunks=(2, 3, 2, 4))[...] = first
    axes = [{'name': 'c', 'type': 'channel'}] + [{'name': n, 'type': 'space'} for n in 'zyx']
    image = zarr.open_group(tool.path('flow.ome.zarr'), mode='w', attributes={'ome': {'version': '0.5', 'multiscales': [
        {'axes': axes, 'datasets': [{'path': '0', 'coordinateTransformations': [{'type': 'scale', 'scale': [1, 2, 1, 1]}]}]}]}})
    image.create_array('0', data=first)
    lengths = numpy.sqrt((data.astype('f4') ** 2).sum(-1))
    for form, name, array in (('HDF5', 'vectors.h5', 'flow'), ('HDF5', 'vectors.h5', '/last'), ('NetCDF', 'vectors.nc', 'last'), ('Zarr', 'vectors.zarr', 'last'),
                              ('Zarr', 'flow.zarr', ''), ('Zarr', 'flow.ome.zarr', '')):
        source = tool.path(name) + '?as=vectors'
        for field in [array, *(f'{array} {axis}'.strip() for axis in 'xyz')]:
            tool.layout(form, '?as=vectors of three numbers per voxel', source + (f'&field={field}' if field else ''),
                        data[..., 'xyz'.index(field[-1])] if field[-2:-1] in ('', ' ') and field else lengths, type='float32')
    tool.equal(tool.path('vectors.nc') + '?as=vectors', lengths, name='magnitude', vectors='last', other0='last x')
    tool.equal(tool.path('vectors.h5') + '?as=vectors&vectors=/flow', lengths, vectors='/flow')
    tool.refused(tool.path('vectors.h5') + '?as=vectors&field=/other', '?as=vectors', '4 numbers per voxel')
    tool.refused(tool.path('cf.nc') + '?as=vectors&field=ranged', '?as=vectors', '4 numbers per voxel; choose')


def tags(keys, **steps):
    """Returns the axis tags of vigra, which ilastik also writes."""
    flags = {'c': 1, 't': 8}
    return json.dumps({'axes': [{'key': k, 'typeFlags': flags.get(k, 2), 'resolution': steps.get(k, 0), 'description': ''} for k in keys]}, indent=2)


def check_tags(tool):
    path = tool.path('tags.h5')
    data = ramp((3, 2, 4, 5, 2), 'u1')
    with h5py.File(path, 'w') as file:
        for name, shape, own in (('tzyxc', data.shape, tags('tzyxc', x=0.5, y=0.5, z=2)), ('xyzc', (6, 5, 4, 3), tags('xyzc', x=0.25)),
                                 ('cxy', (3, 4, 5), tags('cxy')), ('wrong', (3, 4, 5), tags('xy')), ('words', (3, 4, 5), 'z y x')):
            file[name] = ramp(shape, 'u1')
            file[name].attrs['axistags'] = own
    layout = 'axistags of vigra and ilastik'
    tool.layout('HDF5', layout, f'{path}:/tzyxc 2', data[1, ..., 1], step=1, steps=3, spacing=[0.5, 0.5, 2])
    tool.layout('HDF5', layout, f'{path}:/xyzc 3', ramp((6, 5, 4, 3), 'u1')[..., 2].T, spacing=[0.25, 1, 1], other0='/xyzc 1')
    tool.layout('HDF5', layout, f'{path}:/cxy 2', ramp((3, 4, 5), 'u1')[1].T[None])
    for name in ('wrong', 'words'):
        tool.equal(f'{path}:/{name}', ramp((3, 4, 5), 'u1'), warnings=['The attribute axistags was left out: it does not have one axis for each of the '
                                                                          '3 dimensions.'])


def check_kinds(tool):
    """Kinds of numbers: categories, colours, and places that a grid cannot have."""
    flags = ramp((3, 4, 5), 'i1') % 4
    with netCDF4.Dataset(tool.path('kinds.nc'), 'w') as file:
        for name, size in zip('zyx', flags.shape):
            file.createDimension(name, size)
        file.createVariable('lat', 'f4', ('y', 'x'))[:] = 1
        file.createVariable('flags', 'i1', ('z', 'y', 'x'))[:] = flags
        file['flags'].setncatts({'flag_values': numpy.arange(4, dtype='i1'), 'flag_meanings': 'sea land ice cloud', 'coordinates': 'lat lon'})
    tool.layout('NetCDF', 'flag_values and flag_meanings: labels', tool.path('kinds.nc'), flags, meaning='labels', type='int8')
    tool.layout('NetCDF', 'coordinates of two dimensions', tool.path('kinds.nc'), flags, result='indices, and a warning',
                warnings=['The coordinates lat have 2 dimensions: the array is shown on an even grid of its indices.'])
    with netCDF4.Dataset(tool.path('plain.h5'), 'w') as file:
        for name, size in zip('tzyx', (2, 3, 4, 5)):
            file.createDimension(name, size)
        file.createVariable('v', 'u1', tuple('tzyx'))[:] = ramp((2, 3, 4, 5), 'u1')
    tool.layout('HDF5', 'dimensions of NetCDF-4 without coordinates', tool.path('plain.h5'), ramp((2, 3, 4, 5), 'u1')[1], step=1, steps=2, name='/v',
                warnings=[])
    pixels = ramp((6, 7, 3), 'u1')
    with h5py.File(tool.path('kinds.h5'), 'w') as file:
        for name, data, mode in (('pixel', pixels, 'INTERLACE_PIXEL'), ('plane', numpy.ascontiguousarray(numpy.moveaxis(pixels, -1, 0)), 'INTERLACE_PLANE')):
            file[name] = data
            for key, value in (('CLASS', 'IMAGE'), ('IMAGE_SUBCLASS', 'IMAGE_TRUECOLOR'), ('INTERLACE_MODE', mode)):
                file[name].attrs[key] = numpy.bytes_(value)
    for name in ('pixel', 'plane'):
        tool.layout('HDF5', 'images in colours (IMAGE_TRUECOLOR)', f"{tool.path('kinds.h5')}:/{name} 2", pixels[None, ..., 1])
    axes = [{'name': n, 'type': 'space'} for n in 'zyx']
    group = zarr.open_group(tool.path('labels.zarr'), mode='w', attributes={'ome': {'version': '0.5', 'image-label': {}, 'multiscales': [
        {'axes': axes, 'datasets': [{'path': '0', 'coordinateTransformations': [{'type': 'scale', 'scale': [1, 1, 1]}]}]}]}})
    group.create_array('0', data=ramp((3, 4, 5), 'u2'))
    tool.layout('Zarr', 'labels of OME-Zarr (image-label)', tool.path('labels.zarr'), ramp((3, 4, 5), 'u2'), meaning='labels')


def check_sizes(tool):
    """The size of a voxel as an attribute, and scales with other names than the dimensions."""
    path = tool.path('sizes.h5')
    data = ramp((4, 5, 6), 'u1')
    with h5py.File(path, 'w') as file:
        for name in ('spacing', 'voxel_size_nm', 'resolution', 'one', 'few', 'scaled', 'falling'):
            file[name] = data
        file['stack'] = ramp((2, 4, 5, 6), 'u1')
        file['stack'].attrs['element_size_um'] = [3.0, 2.0, 0.5]
        file['spacing'].attrs['spacing'] = [3.0, 2.0, 0.5]
        file['voxel_size_nm'].attrs['voxel_size_nm'] = [30, 20, 10]
        file['resolution'].attrs.update({'resolution': [40.0, 4, 4], 'offset': [400.0, 8, 12], 'unit': 'nm'})
        file['one'].attrs['pixel_size_um'] = 0.7
        file['few'].attrs['spacing'] = [1.0, 2.0]
        for name, values in (('a', [5, 7, 9, 11]), ('b', [0, 1, 2, 3, 4]), ('c', [9.0, 8, 7, 6, 5, 4]), ('d', [0, 1, 4, 9])):
            file['scales/' + name] = values
            file['scales/' + name].make_scale('length ' + name)
            file['scales/' + name].attrs['units'] = 'mm'
        for d, (name, label) in enumerate((('a', 'z'), ('b', 'y'), ('c', 'x'))):
            file['falling'].dims[d].attach_scale(file['scales/' + name])
            file['scaled'].dims[d].attach_scale(file['scales/' + ('d' if d == 0 else name)])
            file['scaled'].dims[d].label = label
    note = 'The attribute {} gives the spacing, in the order of the dimensions{}.'
    layout = 'the size of a voxel as an attribute (element_size_um, spacing, voxel_size, pixel_size, resolution)'
    tool.layout('HDF5', layout, f'{path}:/stack 2', ramp((2, 4, 5, 6), 'u1')[1], spacing=[0.5, 2, 3], unit='um', warnings=[])
    tool.layout('HDF5', layout, f'{path}:/spacing', data, spacing=[0.5, 2, 3], unit='',
                warnings=[note.format('spacing', '; the file does not tell its unit')])
    tool.layout('HDF5', layout, f'{path}:/voxel_size_nm', data, spacing=[10, 20, 30], unit='nm', warnings=[])
    tool.layout('HDF5', layout, f'{path}:/resolution', data, spacing=[4, 4, 40], origin=[12, 8, 400], unit='nm', warnings=[note.format('resolution', '')])
    tool.layout('HDF5', layout, f'{path}:/one', data, spacing=[0.7, 0.7, 0.7], unit='um')
    tool.equal(f'{path}:/few', data, spacing=[1, 1, 1],
               warnings=['The attribute spacing was left out: it has 2 numbers, the array 3 dimensions of space.'])
    layout = 'dimension scales: even, uneven and falling, with and without labels'
    tool.layout('HDF5', layout, f'{path}:/falling', data, origin=[9, 0, 5], spacing=[1, 1, 2], direction=[-1, 0, 0, 0, 1, 0, 0, 0, 1], unit='mm')
    tool.layout('HDF5', layout, f'{path}:/scaled', data, origin=[9, 0, 0], coordinates2=[0, 1, 4, 9], unit='mm')
    path = tool.path('alone.h5')
    with h5py.File(path, 'w') as file:
        file.attrs['spacing_mm'] = [3.0, 2.0, 0.5]
        file['data'], file['z'] = data, numpy.arange(4) * 0.5
        file['z'].make_scale('z')
    tool.layout('HDF5', 'the size of a voxel in the root group; scales are not chosen', path, data, spacing=[0.5, 2, 3], unit='mm')


def check_zarr(tool):
    """Properties that only Zarr has."""
    data = ramp((2, 3, 4), 'f4')
    fill = float(data[0, 1, 2])
    group = zarr.open_group(tool.path('fields.zarr'), mode='w')
    text = base64.b64encode(struct.pack('<d', fill)).decode()
    group.create_array('b', shape=data.shape, dtype='f4', dimension_names=('z', 'y', 'x'), attributes={'_FillValue': text, 'units': 'V'})[...] = data
    group.create_array('sub/a', shape=data.shape, dtype='f4', dimension_names=('z', 'y', 'x'))[...] = data + 1
    group.create_array('x', shape=(4,), dtype='i4', dimension_names=('x',))[...] = [7, 5, 3, 1]
    path = tool.path('fields.zarr')
    tool.layout('Zarr', 'several arrays: the first one that is no coordinate', path, numpy.where(data == fill, numpy.nan, data), name='b', other0='sub/a',
                value_unit='V', spacing=[2, 1, 1], origin=[7, 0, 0], direction=[-1, 0, 0, 0, 1, 0, 0, 0, 1])
    tool.equal(path + '?field=sub/a', data + 1, spacing=[2, 1, 1])
    tool.refused(path + '?field=c', 'no such array', 'b (2 x 3 x 4)', 'sub/a')
    group = zarr.open_group(tool.path('units.zarr'), mode='w')
    for name, values, unit in (('z', [0, 4], ''), ('y', [0, 1, 2], 'mm'), ('x', [0, 1, 2, 3], 'mm'), ('lat', [0, 1, 2], 'degrees_north'),
                               ('lon', [0, 1, 2, 3], 'degrees_east')):
        group.create_array(name, shape=(len(values),), dtype='i4', dimension_names=(name,), attributes={'units': unit} if unit else {})[...] = values
    for name, dims in (('a', ('z', 'y', 'x')), ('b', ('z', 'lat', 'lon')), ('c', ('member', 'lat', 'lon'))):
        group.create_array(name, shape=data.shape, dtype='f4', dimension_names=dims)[...] = data
    path = tool.path('units.zarr')
    tool.equal(path, data, spacing=[1, 1, 4], unit='mm', warnings=['Only some of the axes have a unit; their coordinates were taken as they are.'])
    tool.equal(path + '?field=b', data, spacing=[1, 1, 0.75], unit='degrees',
               warnings=['The vertical axis has no unit and the horizontal ones "degrees_east": it was scaled to a quarter of their length.'])
    tool.layout('Zarr', 'members of an ensemble', path + '?field=c 2', data[1:])
    path = tool.path('fields.zarr')
    own = ramp((2, 3, 4), 'i2')
    array = zarr.create_array(tool.path('alone.zarr'), shape=own.shape, dtype='i2', zarr_format=2, fill_value=0,
                              attributes={'_ARRAY_DIMENSIONS': ['z', 'y', 'x'], 'long_name': 'dose', 'units': 'Gy', 'add_offset': 1.0})
    array[...] = own
    tool.equal(tool.path('alone.zarr'), numpy.where(own == 0, numpy.nan, own.astype('f4') + 1), name='dose', value_unit='Gy')
    counts = zarr.create_array(tool.path('counts.zarr'), shape=own.shape, dtype='i2', zarr_format=2, fill_value=0,
                               attributes={'_ARRAY_DIMENSIONS': ['channel', 'y', 'x']})
    counts[...] = own
    tool.layout('Zarr', 'a dimension with the name of channels', tool.path('counts.zarr') + '?field=channel 2', own[1:], name='channel 2', other0='channel 1',
                type='int16')
    tool.refused(tool.path('counts.zarr') + '?field=channel 3', 'channel 3', 'channel 1 to channel 2')
    tool.refused(os.path.join(path, 'b') + '?level=1', 'no level 1')
