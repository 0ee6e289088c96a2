# SPDX-License-Identifier: Apache-2.0
"""Every type in every format that can hold it, in both byte orders. Other parts add the rows of their formats."""
import json

import h5py
import netCDF4
import numcodecs
import numpy
import tifffile
import zarr
from zarr.codecs import BytesCodec

SHAPE = (3, 4, 16)
NUMBERS = ('int8', 'uint8', 'int16', 'uint16', 'int32', 'uint32', 'int64', 'uint64', 'float16', 'float32', 'float64', 'complex64', 'complex128')


def samples(kind, shape=SHAPE):
    """Numbers of the kind with its extremes, and fractions if it has them. Magnitudes of complex ones are exact."""
    count = int(numpy.prod(shape))
    ramp = (numpy.arange(count) * 37 + 11) % 251
    dtype = numpy.dtype('bool' if kind == '1 bit' else kind)
    if dtype.kind == 'b':
        values = ramp % 3 == 0
    elif dtype.kind == 'c':
        values = ramp * (3 - 4j) / 8
    elif dtype.kind == 'f':
        values = (ramp - 100) / 8
        values[:4] = numpy.finfo(dtype).max, numpy.finfo(dtype).smallest_subnormal, numpy.inf, numpy.nan
    else:
        values = ramp.astype(dtype)
        values[:2] = numpy.iinfo(dtype).min, numpy.iinfo(dtype).max
    return values.astype(dtype).reshape(shape)


def widened(values):
    """Returns the numbers as the volume stores them in memory."""
    values = numpy.asarray(values)
    if values.dtype.kind == 'c':
        return numpy.abs(values)
    if values.dtype.kind == 'b':
        return values.astype('u1')
    if values.dtype == numpy.float16:
        return values.astype('f4')
    return values.astype('f8') if values.dtype in ('u4', 'i8', 'u8') else values


def orders(kind):
    """The dtypes of a kind in both byte orders."""
    dtype = numpy.dtype(kind)
    return [dtype] if dtype.itemsize == 1 else [dtype.newbyteorder('<'), dtype.newbyteorder('>')]


def check_kind(tool, form, kind, source, values):
    """Compares, and adds the row."""
    expected = widened(values)
    tool.typed(form, kind, source, expected)


def check_tiff(tool):
    path = tool.path('type.tif')
    tifffile.imwrite(path, samples('1 bit'))
    check_kind(tool, 'TIFF', '1 bit', path, samples('1 bit'))
    for kind in NUMBERS:
        for dtype in orders(kind):
            tifffile.imwrite(path, samples(kind).astype(dtype), photometric='minisblack', metadata=None,
                             byteorder='>' if dtype.byteorder == '>' else '<')
            check_kind(tool, 'TIFF', kind, path, samples(kind))
    for kind, count in (('RGB', 3), ('RGBA', 4)):
        colours = samples('uint8', (*SHAPE, count))
        tifffile.imwrite(path, colours, photometric='rgb', metadata=None, extrasamples=['unassalpha'] if count == 4 else None)
        check_colours(tool, 'TIFF', kind, path, colours)


def check_colours(tool, name, kind, path, colours):
    for i, field in enumerate(('red', 'green', 'blue', 'alpha')[:colours.shape[-1]]):
        tool.typed(name, kind, f'{path}?field={field}', colours[..., i], name=field)


def check_zarr(tool):
    path = tool.path('type.zarr')
    for kind in ('1 bit', *NUMBERS):
        values = samples(kind)
        for dtype in [values.dtype] if kind == '1 bit' else orders(kind):
            zarr.create_array(path, shape=SHAPE, chunks=(2, 3, 5), dtype=dtype, zarr_format=2, overwrite=True,
                              compressors=numcodecs.Zlib())[...] = values
            check_kind(tool, 'Zarr v2', kind, path, values)
            endian = 'big' if dtype.byteorder == '>' else 'little'
            zarr.create_array(path, shape=SHAPE, chunks=(2, 3, 5), dtype=values.dtype, overwrite=True, serializer=BytesCodec(endian=endian),
                              compressors=None)[...] = values
            check_kind(tool, 'Zarr v3', kind, path, values)
    for kind, count in (('RGB', 3), ('RGBA', 4)):
        colours = samples('uint8', (*SHAPE, count))
        zarr.create_array(path, data=colours, chunks=(2, 4, 3, count), zarr_format=2, overwrite=True)
        check_colours(tool, 'Zarr v2', kind, path, colours)


def check_hdf5(tool):
    path = tool.path('type.h5')
    with h5py.File(path, 'w') as file:
        for kind in ('1 bit', *NUMBERS):
            for dtype in ['bool'] if kind == '1 bit' else orders(kind):
                file[f'{kind}/{numpy.dtype(dtype).str}'] = samples(kind).astype(dtype)
        file['RGB'], file['RGBA'] = samples('uint8', (*SHAPE, 3)), samples('uint8', (*SHAPE, 4))
    for kind in ('1 bit', *NUMBERS):
        for dtype in ['bool'] if kind == '1 bit' else orders(kind):
            check_kind(tool, 'HDF5', kind, f'{path}:/{kind}/{numpy.dtype(dtype).str}', samples(kind))
    for kind, count in (('RGB', 3), ('RGBA', 4)):
        for i in range(count):
            tool.typed('HDF5', kind, f'{path}:/{kind} {i + 1}', samples('uint8', (*SHAPE, count))[..., i])


def netcdf_samples(kind):
    """Returns samples without NetCDF's fill number, which readers leave out."""
    values = samples(kind)
    fill = netCDF4.default_fillvals.get(values.dtype.str[1:])
    return numpy.where(values == fill, fill - 1, values).astype(values.dtype) if values.dtype.kind in 'iu' and values.dtype.itemsize > 1 else values


def check_netcdf(tool):
    kinds = [kind for kind in NUMBERS if kind != 'float16']
    for name, form in (('NetCDF-4', 'NETCDF4'), ('NetCDF classic', 'NETCDF3_CLASSIC'), ('CDF-5', 'NETCDF3_64BIT_DATA')):
        path = tool.path(f'{form}.nc')
        classic = ('int8', 'int16', 'int32', 'float32', 'float64')
        own = [k for k in kinds if (form == 'NETCDF4' or not k.startswith('complex')) and (form != 'NETCDF3_CLASSIC' or k in classic)]
        with netCDF4.Dataset(path, 'w', format=form, auto_complex=True) as file:
            file.set_auto_maskandscale(False)
            for axis, size in zip('zyx', SHAPE):
                file.createDimension(axis, size)
            for kind in own:
                for endian in ('little', 'big') if form == 'NETCDF4' and not kind.startswith('complex') else ('native',):
                    dtype = kind if endian == 'native' or kind.endswith('int8') else numpy.dtype(kind).newbyteorder(endian[0])
                    file.createVariable(f'{kind}_{endian}', dtype, tuple('zyx'), endian=endian)[:] = netcdf_samples(kind)
        for kind in own:
            for endian in ('little', 'big') if form == 'NETCDF4' and not kind.startswith('complex') else ('native',):
                check_kind(tool, name, kind, f'{path}:/{kind}_{endian}', netcdf_samples(kind))


def check_raw(tool):
    path = tool.path('type.json')
    for kind in NUMBERS:
        for dtype in orders(kind):
            samples(kind).astype(dtype).tofile(tool.path('type.raw'))
            with open(path, 'w', encoding='utf-8') as file:
                json.dump({'dims': SHAPE[::-1], 'type': kind, 'endian': 'big' if dtype.byteorder == '>' else 'little', 'file': 'type.raw'}, file)
            check_kind(tool, 'raw', kind, path, samples(kind))


def check(tool):
    check_tiff(tool)
    check_zarr(tool)
    check_hdf5(tool)
    check_netcdf(tool)
    check_raw(tool)
