# SPDX-License-Identifier: Apache-2.0
"""Coordinates of arrays: packed coordinates, names of units, longitudes that wrap, and axes that are no space."""
import json
import os

import h5py
import netCDF4
import numpy
import SimpleITK
import zarr

from ramp import ramp

SHAPE = (3, 4, 5)


def write_nc(tool, name, axes, data=None, extra=()):
    """A variable `v` with one-dimensional coordinates: {name: (stored numbers, attributes)}; None = without coordinates."""
    path = tool.path(name)
    data = ramp([len(values) for values, _ in axes.values()], 'f4') if data is None else data
    with netCDF4.Dataset(path, 'w') as file:
        for (axis, (values, attributes)), size in zip(axes.items(), data.shape):
            file.createDimension(axis, size)
            if attributes is None:
                continue
            values = numpy.asarray(values)
            fill = attributes.get('_FillValue')
            variable = file.createVariable(axis, values.dtype, (axis,), fill_value=fill)
            variable.set_auto_maskandscale(False)
            variable.setncatts({key: value for key, value in attributes.items() if key != '_FillValue'})
            variable[:] = values
        file.createVariable('v', data.dtype, tuple(axes))[:] = data
        for key, value in extra:
            file['v'].setncattr(key, value)
    return path, data


def packed_axes():
    """Whole numbers with scale_factor and add_offset: x 5, 5.25, …; z falls; y is uneven and unsigned; and the time."""
    return {'time': (numpy.array([0, 1, 4], 'i2'), {'units': 'hours since 2000-01-01', 'scale_factor': 0.5, 'add_offset': 10.0}),
            'z': (numpy.array([4, 3, 2, 1], 'i1'), {'units': 'mm', 'scale_factor': 2.0, '_FillValue': numpy.int8(-1)}),
            'y': (numpy.array([0, 100, -6], 'i1'), {'units': 'mm', '_Unsigned': 'true', 'add_offset': -50.0}),
            'x': (numpy.arange(5, dtype='i2'), {'units': 'mm', 'scale_factor': 0.25, 'add_offset': 5.0})}


def check_packed(tool):
    axes = packed_axes()
    path, data = write_nc(tool, 'packed.nc', axes)
    group = zarr.open_group(tool.path('packed.zarr'), mode='w', zarr_format=2)
    with h5py.File(tool.path('packed.h5'), 'w') as file:
        file['v'] = data
        for d, (name, (values, attributes)) in enumerate(axes.items()):
            file[name] = values
            file[name].make_scale(name)
            file['v'].dims[d].attach_scale(file[name])
            file[name].attrs.update(attributes)
            own = {key: value.item() if hasattr(value, 'item') else value for key, value in attributes.items()}
            group.create_array(name, shape=values.shape, dtype=values.dtype, fill_value=None, attributes={'_ARRAY_DIMENSIONS': [name], **own})[...] = values
    group.create_array('v', shape=data.shape, dtype='f4', fill_value=None, attributes={'_ARRAY_DIMENSIONS': list(axes)})[...] = data
    for form, source in (('NetCDF', path), ('HDF5', tool.path('packed.h5')), ('Zarr', tool.path('packed.zarr'))):
        tool.layout(form, 'packed coordinates (scale_factor, add_offset, _Unsigned)', source, data[2], step=2, steps=3, times=[10, 10.5, 12],
                    spacing=[0.25, 125, 2], origin=[5, -50, 8], coordinates1=[0, 100, 250], direction=[1, 0, 0, 0, 1, 0, 0, 0, -1], unit='mm')
    path, data = write_nc(tool, 'gap.nc', {'y': (numpy.arange(3.0), {'units': 'm'}), 'x': (numpy.array([0, 1, -9, 3]), {'units': 'm', '_FillValue': -9})})
    tool.equal(path, data[None], spacing=[1, 1, 1], unit='', warned='The coordinates of the dimension x')


def check_units(tool):
    """Each unit in the plural and spelled out, with x in another unit: (unit of x, unit of z, z in units of x, displayed unit)."""
    for of_x, of_z, factor, shown in (('kilometers', 'meters', 1e-3, 'km'), ('Metres', 'kilometre', 1e3, 'm'), ('micrometers', 'nanometers', 1e-3, 'um'),
                                      ('micron', 'Microns', 1, 'um'), ('millimetres', 'centimeters', 10, 'mm'), ('cm', 'inches', 2.54, 'cm'),
                                      ('feet', 'foot', 1, 'ft'), ('kpc', 'pc', 1e-3, 'kpc'), ('Mpc', 'kiloparsecs', 1e-3, 'Mpc'), ('um', 'Angstroms', 1e-4, 'um')):
        path, data = write_nc(tool, 'units.nc', {'z': (numpy.arange(3.0), {'units': of_z}), 'y': (numpy.arange(4.0), {'units': of_x}),
                                                 'x': (numpy.arange(5.0), {'units': of_x})})
        tool.equal(path, data, spacing=[1, 1, factor], unit=shown, warned='')
    tool.equal(tool.path('units.nc') + '?unit=micrometres', data, unit='um')
    path, data = write_nc(tool, 'lone.nc', {'z': ((), None), 'y': ((), None), 'x': (numpy.arange(5.0), {'units': 'micrometers'})}, ramp(SHAPE, 'f4'))
    tool.equal(path, data, spacing=[1, 1, 1], unit='um', warned='Only some of the axes have a unit')


def check_axes(tool):
    """Wavelengths are no space, and longitudes go on after 180."""
    data = ramp(SHAPE, 'f4')
    metres = {'units': 'm'}
    for name, attributes in (('wavelength', {'units': 'nm'}), ('w', {'units': 'nm', 'standard_name': 'radiation_wavelength'}), ('energy', {'units': 'eV'})):
        path, _ = write_nc(tool, 'bands.nc', {name: (numpy.arange(400.0, 700, 100), attributes), 'y': (numpy.arange(4.0), metres),
                                              'x': (numpy.arange(5.0), metres)}, data)
        tool.layout('NetCDF', 'wavelengths, frequencies and energies', path + '?field=v 2', data[1][None], 'fields', spacing=[1, 1, 1], unit='m', warned='')
    with h5py.File(tool.path('bands.h5'), 'w') as file:
        file['v'] = data
        for d, name in enumerate(('y', 'x', 'wavenumber')):
            file['v'].dims[d].label = name
    tool.layout('HDF5', 'wavelengths, frequencies and energies', tool.path('bands.h5') + ':/v 3', data[..., 2][None], 'fields')
    for numbers, unit, step in (([176, 178, -180, -178, -176], 'degrees_east', 2), ([358, 359, 0, 1, 2], 'degrees_east', 1),
                                ([-178, 180, 178, 176, 174], 'degree_E', 2), ([178, 179, 180, -179, -178], 'degrees', 1)):
        path, _ = write_nc(tool, 'lon.nc', {'z': (numpy.arange(3.0), metres), 'lat': (numpy.arange(4.0), {'units': 'degrees_north'}),
                                            'lon': (numpy.array(numbers, 'f4'), {'units': unit})}, data)
        tool.equal(path, data, spacing=[step, 1, 0.25 * max(4 * step, 3) / 2], origin=[numbers[0], 0, 0], unit='degrees')
    path, _ = write_nc(tool, 'bare.nc', {'lat': (numpy.arange(4.0), {}), 'lon': (numpy.array([178, 179, -180, -179, -178.0]), {})}, data[0])
    tool.equal(path, data[:1], spacing=[1, 1, 1], origin=[178, 0, 0], warned='')
    path, _ = write_nc(tool, 'mixed.nc', {'z': (numpy.arange(3.0), metres), 'lat': (numpy.arange(4.0), {'units': 'degrees_north'}),
                                          'lon': (numpy.array([5.0, 3, 9, 1, 2]), {'units': 'degrees_east'})}, data)
    tool.equal(path, data, spacing=[1, 1, 1], unit='', warned='do not rise or fall throughout')


def check_itk(tool):
    """HDF5 of ITK: the place, as SimpleITK reads it; a flat image, an image with components, and an image with times."""
    layout = 'images of ITK and SimpleITK (/ITKImage/0/VoxelData)'
    data = ramp((4, 5, 6), 'i2')
    turned = (0, 1, 0, -1, 0, 0, 0, 0, 1)
    for name, array, is_vector in (('scalars', data, False), ('vectors', ramp((4, 5, 6, 3), 'f4'), True)):
        image = SimpleITK.GetImageFromArray(array, isVector=is_vector)
        image.SetSpacing((0.7, 0.5, 2))
        image.SetOrigin((1, 2, 3))
        image.SetDirection(turned)
        path = tool.path(f'itk_{name}.h5')
        SimpleITK.WriteImage(image, path)
        field = '?field=/ITKImage/0/VoxelData 2' if is_vector else ''
        tool.layout('HDF5', layout, path + field, array[..., 1] if is_vector else array, spacing=[0.7, 0.5, 2], origin=[1, 2, 3], direction=turned,
                    unit='mm', anatomy='LPS', warned='')
    tool.equal(path + '?as=vectors', numpy.sqrt((array ** 2).sum(-1)), spacing=[0.7, 0.5, 2], vectors='/ITKImage/0/VoxelData')
    flat = SimpleITK.GetImageFromArray(data[0])
    flat.SetSpacing((0.7, 0.5))
    flat.SetOrigin((1, 2))
    SimpleITK.WriteImage(flat, tool.path('itk_flat.h5'))
    tool.equal(tool.path('itk_flat.h5'), data[:1], spacing=[0.7, 0.5, 0.7], origin=[1, 2, 0], unit='mm')
    series = SimpleITK.GetImageFromArray(ramp((2, 4, 5, 6), 'u1'), isVector=False)
    series.SetSpacing((0.7, 0.5, 2, 1.5))
    SimpleITK.WriteImage(series, tool.path('itk_times.h5'))
    tool.equal(tool.path('itk_times.h5'), ramp((2, 4, 5, 6), 'u1')[1], step=1, steps=2, spacing=[0.7, 0.5, 2])
    with h5py.File(tool.path('itk_flat.h5'), 'r+') as file:
        file['ITKImage/0/Spacing'][:] = [-1, 1]
    tool.equal(tool.path('itk_flat.h5'), data[:1], spacing=[1, 1, 1], warned='no valid Spacing and Origin')


def check_channels_last(tool):
    """Plain arrays of four or five dimensions, the last one short; and files with a block of the user before the signature."""
    layout = 'without names, the last dimension short and the others long: channels, with a warning'
    data, series = ramp((6, 7, 8, 3), 'f4'), ramp((2, 6, 7, 8, 2), 'i2')
    with h5py.File(tool.path('last.h5'), 'w') as file:
        file['v'] = data
    with h5py.File(tool.path('series.h5'), 'w') as file:
        file['v'] = series
    zarr.create_array(tool.path('last.zarr'), shape=data.shape, dtype='f4')[...] = data
    for form, path, name in (('HDF5', tool.path('last.h5'), '/v'), ('Zarr', tool.path('last.zarr'), 'channel')):
        tool.layout(form, layout, f'{path}?field={name} 2', data[..., 1], warned='the last one, of length 3, was taken for channels')
        tool.equal(f'{path}?as=vectors', numpy.sqrt((data ** 2).sum(-1)))
    tool.equal(tool.path('series.h5') + ':/v 2', series[1, ..., 1], step=1, steps=2)
    for size in (512, 1024, 4096, 8192):
        path = tool.path(f'user{size}.mat')
        with h5py.File(path, 'w', userblock_size=size) as file:
            file['V'] = data[..., 0]
        with open(path, 'r+b') as file:
            file.write(b'MATLAB 7.3 MAT-file')
        tool.layout('HDF5', 'a block of the user before the signature, as MATLAB 7.3 writes it (.mat)', path, data[..., 0])
    for name, dtype in (('bytes', 'u1'), ('floats', 'f4')):
        pixels = ramp((20, 30, 3), dtype)
        with h5py.File(tool.path(name + '.h5'), 'w') as file:
            file['v'] = pixels
        tool.equal(tool.path(name + '.h5') + ':/v 3', pixels[None, ..., 2], warned='was taken for channels')
    check_lengths(tool)
    numbers = ramp((3, 4, 5), 'u1')
    with h5py.File(tool.path('user.nc'), 'w', userblock_size=512) as file:
        file['V'] = numbers
    tool.equal(tool.path('user.nc'), numbers)


def check_auxiliary(tool):
    """Coordinates that do not have the name of a dimension, and depths."""
    data = ramp((3, 4, 5, 6), 'f4')

    def write(name, dims, values, attributes=(), globals_=(), **beside):
        with netCDF4.Dataset(tool.path(name), 'w') as file:
            for own, size in zip(dims, values.shape):
                file.createDimension(own, size)
            variable = file.createVariable('v', 'f4', dims)
            variable[:] = values
            variable.setncatts(dict(attributes))
            file.setncatts(dict(globals_))
            for own, (own_dims, numbers, own_attributes) in beside.items():
                numbers = numpy.asarray(numbers)
                file.createVariable(own, str if numbers.dtype.kind == 'O' else 'f8', own_dims)[:] = numbers
                file[own].setncatts(own_attributes)
        return tool.path(name)

    for depths, own, is_down in (([0, 10, 20, 30], {'standard_name': 'depth'}, True), ([0, 10, 20, 30], {}, True), ([0, -10, -20, -30], {}, False),
                                 ([0, 10, 20, 30], {'standard_name': 'depth', 'positive': 'up'}, False), ([0, 10, 20, 30], {'positive': 'down'}, True)):
        path = write('depth.nc', ('depth', 'y', 'x'), data[0], depth=(('depth',), depths, {'units': 'm', **own}), x=(('x',), range(6), {'units': 'm'}),
                     y=(('y',), range(5), {'units': 'm'}))
        tool.layout('NetCDF', 'a depth grows downwards, unless it says otherwise or is below 0', path, data[0],
                    direction=[1, 0, 0, 0, 1, 0, 0, 0, -1 if is_down or depths[1] < 0 else 1], warned='')
    for levels in ([1000, 850, 500, 200], [200, 500, 850, 1000]):
        path = write('pressure.nc', ('plev', 'lat', 'lon'), data[0], plev=(('plev',), levels, {'units': 'hPa'}), lat=(('lat',), range(5), {'units': 'degrees_north'}),
                     lon=(('lon',), range(6), {'units': 'degrees_east'}))
        tool.layout('NetCDF', 'pressure beside degrees', path, data[0], unit='degrees', z_per_unit=[-0.25 * 5 / 800], z_unit='hPa',
                    origin=[0, 0, levels[0] * -0.25 * 5 / 800], warned='it was scaled to a quarter',
                    result='read; z gets a quarter of the horizontal extent, with a warning; the volume tells the pressure')
    wrf = ('Time', 'bottom_top', 'south_north', 'west_east')
    path = write('wrf.nc', wrf, data, {'coordinates': 'XLONG XLAT XTIME'}, {'DX': 300.0, 'DY': 200.0},
                 XTIME=(('Time',), [0, 60, 120], {'units': 'minutes since 2000-01-01'}), XLONG=(wrf[2:], data[0, 0], {}), XLAT=(wrf[2:], data[0, 0], {}))
    tool.layout('NetCDF', 'WRF: DX, DY and XTIME', path, data[1], step=1, steps=3, times=[0, 60, 120], time_unit='min', spacing=[300, 200, 125], unit='m', z_per_unit=[125], z_unit='levels',
                warned='The levels of WRF have no height', result='read; levels get a quarter of the horizontal extent, with a warning')
    for name, axis, sizes, attributes in (('west_east', 0, (4, 5, 7), {}), ('south_north', 1, (4, 6, 6), {}), ('bottom_top', 2, (5, 5, 6), {}),
                                          ('west_east', 0, (4, 5, 7), {'stagger': 'X'})):
        own = [dim + ('_stag' if dim == name and not attributes else '') for dim in wrf]
        origin = [0, 0, 0]
        origin[axis] = -(300, 200, 125)[axis] / 2
        path = write('stagger.nc', own[1:], ramp(sizes, 'f4'), attributes, {'DX': 300.0, 'DY': 200.0})
        tool.layout('NetCDF', 'WRF: staggered arrays (U, V, W)', path, ramp(sizes, 'f4'), spacing=[300, 200, 125], origin=origin, unit='m',
                    result='half a cell before the first centre')
    path = write('named.nc', ('a', 'b', 'c'), data[0], {'coordinates': 'north east'}, north=(('b',), [5, 4, 3, 2, 1], {'units': 'degrees_north'}),
                 east=(('c',), numpy.arange(6) * 2, {'units': 'degrees_east'}))
    tool.layout('NetCDF', 'coordinates of one dimension, of another name', path, data[0], spacing=[2, 1, 2.5 / 3], origin=[0, 5, 0], unit='degrees')
    path = write('words.nc', ('time', 'z', 'y', 'x'), data, time=(('time',), numpy.array(['a', 'b', 'c'], object), {}))
    tool.layout('NetCDF', 'times as text', path, data[2], step=2, steps=3, warned='The times in time were left out: it has no numbers but text',
                result='steps without times, and a warning')
    places = {name: (('n',), range(4), {'units': unit}) for name, unit in (('lat', 'degrees_north'), ('lon', 'degrees_east'))}
    path = write('points.nc', ('n',), data[0, :, 0, 0], {'coordinates': 'lat lon'}, **places)
    tool.layout('NetCDF', 'points and tracks (lat and lon of each entry)', path, data[0, :, 0, 0][None, None],
                warned='The coordinates lat and lon place each entry of the dimension n on its own', result='a row, and a warning')
    for name, attributes in (('icon.nc', {'CDI_grid_type': 'unstructured', 'coordinates': 'lat lon'}), ('ugrid.nc', {'mesh': 'm', 'location': 'face'})):
        path = write(name, ('lev', 'n'), data[0, :, 0, :4], attributes, **places)
        tool.layout_refused('NetCDF', 'cells of an unstructured grid (ICON, UGRID)', path, 'cells of an unstructured grid', 'cdo remapbil')


def check_lengths(tool):
    """The reader guesses channels and time from the lengths; a file of Keras or DREAM.3D ends with a length of 1. In NetCDF the names tell nothing."""
    layout = 'without names, the last dimensions of length 1: they play no part'
    told = 'The file does not tell what its dimensions are; the'
    for shape, place, steps, channels, layout, warning in (
            ((6, 7, 8, 1), (..., 0), 1, 1, layout, ''), ((6, 7, 8, 1, 1), (..., 0, 0), 1, 1, layout, ''), ((6, 7, 1), (None, ..., 0), 1, 1, layout, ''),
            ((1, 6, 7, 8, 1), (0, ..., 0), 1, 1, layout, ''),
            ((9, 6, 7, 8, 1), (4, ..., 0), 9, 1, 'without names, five dimensions, the last of length 1: time first', ''),
            ((20, 21, 22, 6), (..., 1), 1, 6, 'without names, 5 to 9 numbers per voxel', f'{told} last one, of length 6, was taken for channels'),
            ((6, 5, 7, 8), 1, 1, 6, 'without names, more than 4 entries in the place of channels', f'{told} first one, of length 6, was taken for channels; with ?as=time')):
        data = ramp(shape, 'f4')
        paths = [tool.path(f'{"x".join(map(str, shape))}.{form}') for form in ('h5', 'nc', 'zarr')]
        with h5py.File(paths[0], 'w') as file:
            file['v'] = data
        with netCDF4.Dataset(paths[1], 'w') as file:
            for d, size in enumerate(shape):
                file.createDimension(f'phony_dim_{d}', size)
            file.createVariable('v', 'f4', [f'phony_dim_{d}' for d in range(len(shape))])[:] = data
        zarr.create_array(paths[2], shape=shape, dtype='f4')[...] = data
        for form, path, name in zip(('HDF5', 'NetCDF', 'Zarr'), paths, ('/v', 'v', 'channel')):
            field = f'?field={name} 2' if channels > 1 else ''
            tool.layout(form, layout, path + field, data[place], step=4 if steps > 1 else 0, steps=steps, warned=warning)
    for count in (17, 18):  # of a list of 16 others
        with h5py.File(tool.path('many.h5'), 'w') as file:
            file['v'] = ramp((count, 4, 5, 6), 'u1')
        tool.equal(tool.path('many.h5') + ':/v 17', ramp((count, 4, 5, 6), 'u1')[16])
        info, _ = tool.dump(tool.path('many.h5') + ':/v 17')
        if (count == 18) != any('more fields than are listed, at most 16' in text for text in info['warnings']):
            tool.fail('many.h5', f'{count} channels: {info["warnings"]}')
    tool.equal(tool.path('6x5x7x8.h5') + '?as=time', data[3], step=3, steps=6, warned='')


def write_ome(tool, name, version, paths, data):
    """OME-Zarr of two levels in micrometers; the second one is half as fine and lies half a sample further."""
    places = [[{'type': 'scale', 'scale': [2 * f, 0.5 * f, 0.25 * f]}, {'type': 'translation', 'translation': [f, 2, 3]}] for f in (1, 2)]
    image = {'axes': [{'name': n, 'type': 'space', 'unit': 'micrometer'} for n in 'zyx'],
             'datasets': [{'path': path, 'coordinateTransformations': place} for path, place in zip(paths, places)]}
    attributes = {'multiscales': [{'version': '0.4', **image}]} if version == 2 else {'ome': {'version': '0.5', 'multiscales': [image]}}
    group = zarr.open_group(tool.path(name), mode='w', zarr_format=version, attributes=attributes)
    for i, path in enumerate(paths):
        group.create_array(path, data=data[::i + 1, ::i + 1, ::i + 1], chunks=(2, 3, 4), **({'chunk_key_encoding': {'name': 'v2', 'separator': '/'}} if version == 2 else {}))
    return tool.path(name)


def check_levels(tool):
    """A level of OME-Zarr that is opened itself, folders of chunks, and N5."""
    data = ramp((4, 6, 8), 'u2')
    for version, paths in ((2, ('0', '1')), (3, ('0', '1')), (3, ('scale0/image', 'scale1/image'))):
        path = write_ome(tool, f'level{version}{len(paths[0])}.zarr', version, paths, data)
        for i, own in enumerate(paths):
            tool.layout('Zarr', 'a level of OME-Zarr, opened as a folder', os.path.join(path, own), data[::i + 1, ::i + 1, ::i + 1],
                        spacing=[0.25 * (i + 1), 0.5 * (i + 1), 2 * (i + 1)], origin=[3, 2, i + 1], unit='um', warned='')
        tool.refused(os.path.join(path, paths[1]) + '?level=1', 'there is no level 1')
        chunks = os.path.join(path, paths[0], 'c' if version == 3 else '0')
        tool.refused(chunks, 'part of a Zarr array', f'open the folder {"/".join(os.path.join(path, paths[0]).split("/")[-2:])}')
        tool.refused(os.path.join(chunks, '0'), 'part of a Zarr array')
    with open(os.path.join(path, 'zarr.json'), 'r+', encoding='utf-8') as file:
        text = file.read().replace('"scale"', '"shear"')
        file.seek(0)
        file.write(text)
        file.truncate()
    tool.equal(os.path.join(path, paths[0]), data, spacing=[1, 1, 1], warned='the spacing is unknown')
    for name, attributes in (('a.n5', {'n5': '2.5.1'}), ('a.n5/s0', {'dimensions': [8, 6, 4], 'blockSize': [8, 6, 4], 'dataType': 'uint16'})):
        os.makedirs(os.path.join(tool.path(name), '0'))
        with open(os.path.join(tool.path(name), 'attributes.json'), 'w', encoding='utf-8') as file:
            json.dump(attributes, file)
        for source in (tool.path(name), os.path.join(tool.path(name), '0')):
            tool.refused(source, 'a folder of N5', 'convert it to OME-Zarr or TIFF')


def check(tool):
    check_levels(tool)
    check_itk(tool)
    check_auxiliary(tool)
    check_channels_last(tool)
    check_packed(tool)
    check_units(tool)
    check_axes(tool)
