# SPDX-License-Identifier: Apache-2.0
"""NRRD, NIfTI, MetaImage, MRC, GIPL and MGH: types, layouts, encodings and contradictions, against SimpleITK, nibabel, pynrrd and mrcfile.

What these libraries cannot write is written here, byte by byte, and read by them where they can."""
import bz2
import functools
import gzip
import os
import struct
import warnings
import zlib

import h5py
import mrcfile
import netCDF4
import nibabel
import nrrd
import numpy
import SimpleITK

from ramp import ramp

SHAPE = (3, 4, 5)  # z, y, x
INTEGERS = ('i1', 'u1', 'i2', 'u2', 'i4', 'u4', 'i8', 'u8')
REALS = INTEGERS + ('f4', 'f8')
TURNED = numpy.array([[0, -2, 0, 10], [1.5, 0, 0, -20], [0, 0, 3, 30], [0, 0, 0, 1]])


def values(dtype, shape=SHAPE):
    """Samples that use the range of the type as far as float64 holds it."""
    data = ramp(shape, 'f8')
    kind, size = numpy.dtype(dtype).kind, numpy.dtype(dtype).itemsize
    if kind == 'c':
        return (data * 3 + 4j * data).astype(dtype)
    if kind == 'f':
        return (data / 8 - 10).astype(dtype)
    scale = 2.0 ** min(8 * size - 8, 44)
    return (data * scale - (128 * scale if kind == 'i' else 0)).astype(dtype)


def shown(data):
    """Returns the numbers that a volume shows: the magnitudes of complex numbers."""
    return numpy.abs(data) if data.dtype.kind == 'c' else data


def write(tool, name, header, payload=b''):
    path = tool.path(name)
    with open(path, 'wb') as file:
        file.write(header.encode() + payload)
    return path


def warned(tool, path, word):
    """A warning about the file has the word."""
    info, _ = tool.dump(path)
    tool.checks += 1
    if info is not None and not any(word in text for text in info['warnings']):
        tool.fail(path, f'no warning has "{word}": {info["warnings"]}')


def kind_of(dtype):
    """The row of the table of types."""
    return numpy.dtype(dtype).name


def like_itk(tool, path, step=0, is_ras=False, compare=None, **wanted):
    """The volume has the samples and the grid that SimpleITK gives."""
    image = SimpleITK.ReadImage(path)
    data = SimpleITK.GetArrayFromImage(image)
    size = image.GetDimension()
    direction = numpy.reshape(image.GetDirection(), (size, size))[:3, :3]
    origin, spacing = image.GetOrigin()[:3], image.GetSpacing()[:3]
    if is_ras:  # ITK's world is LPS
        turn = numpy.diag([-1, -1, 1])
        direction, origin = turn @ direction, turn @ origin
    lengths = numpy.linalg.norm(direction, axis=0)  # ITK keeps directions of any length
    direction, spacing = direction / lengths, lengths * spacing
    (compare or tool.equal)(path, shown(data[step] if size == 4 else data), step=step, spacing=list(spacing), origin=list(origin),
                            direction=direction.ravel().tolist(), **wanted)


# NRRD

NAMES = {'i1': 'int8', 'u1': 'uchar', 'i2': 'short', 'u2': 'unsigned short', 'i4': 'int', 'u4': 'unsigned int', 'i8': 'long long int',
         'u8': 'uint64', 'f4': 'float', 'f8': 'double'}


def encode(data, encoding):
    raw = data.tobytes()
    text = ' '.join(str(v) for v in data.ravel()).encode()
    return {'raw': raw, 'gzip': gzip.compress(raw), 'bzip2': bz2.compress(raw), 'hex': raw.hex().encode() + b'\n', 'ascii': text}[encoding]


def nrrd_header(dtype, sizes, encoding='raw', fields='', endian=None):
    endian = endian or ('big' if dtype[0] == '>' else 'little')
    return (f'NRRD0004\ntype: {NAMES[dtype.lstrip("<>")]}\ndimension: {len(sizes)}\nsizes: {" ".join(map(str, sizes))}\n'
            f'endian: {endian}\nencoding: {encoding}\n{fields}\n')


def check_nrrd_types(tool):
    for dtype in REALS:
        for order, encoding in (('<', 'raw'), ('>', 'raw'), ('<', 'gzip'), ('>', 'bzip2'), ('>', 'hex'), ('<', 'ascii')):
            data = values(order + dtype)
            tool.typed('NRRD', kind_of(dtype), write(tool, 't.nrrd', nrrd_header(order + dtype, SHAPE[::-1], encoding), encode(data, encoding)), data,
                       f'encoding {encoding}')
        nrrd.write(tool.path('n.nhdr'), values(dtype).T)  # detached, by pynrrd
        tool.layout('NRRD', 'header and samples in two files (.nhdr)', tool.path('n.nhdr'), nrrd.read(tool.path('n.nhdr'))[0].T)
        SimpleITK.WriteImage(SimpleITK.GetImageFromArray(values(dtype)), tool.path('s.nrrd'), True)
        like_itk(tool, tool.path('s.nrrd'))
    big = numpy.full(SHAPE, 2 ** 53 + 1, 'i8')
    warned(tool, write(tool, 'rounded.nrrd', nrrd_header('<i8', SHAPE[::-1]), big.tobytes()), '2^53')


def check_nrrd_layouts(tool):
    colours = values('u1', SHAPE + (3,))
    for kinds in ('RGB-color domain domain domain', 'vector domain domain domain', '3-color space space space'):
        path = write(tool, 'rgb.nrrd', nrrd_header('u1', (3,) + SHAPE[::-1], fields=f'kinds: {kinds}\n'), colours.tobytes())
        for i, name in enumerate(('red', 'green', 'blue')):
            tool.typed('NRRD', 'RGB', f'{path}?field={name}', colours[..., i], name=name)
    with_alpha = values('u1', SHAPE + (4,))
    path = write(tool, 'rgba.nrrd', nrrd_header('u1', (4,) + SHAPE[::-1], fields='kinds: RGBA-color domain domain domain\n'), with_alpha.tobytes())
    for i, name in enumerate(('red', 'green', 'blue', 'alpha')):
        tool.typed('NRRD', 'RGBA', f'{path}?field={name}', with_alpha[..., i], name=name)
    four = values('i2', SHAPE + (4,))
    path = write(tool, 'four.nrrd', nrrd_header('<i2', (4,) + SHAPE[::-1], fields='kinds: vector domain domain domain\n'), four.tobytes())
    tool.layout('NRRD', 'components side by side (the first axis)', f'{path}?field=component 3', four[..., 2])
    path = write(tool, 'planar.nrrd', nrrd_header('<i2', SHAPE[::-1] + (4,), fields='kinds: domain domain domain 4-vector\n'), four.tobytes())
    tool.layout('NRRD', 'components behind one another (the last axis)', f'{path}?field=component 2', four.reshape((4,) + SHAPE)[1])
    both = values('u1', (2,) + SHAPE + (3,))  # time, z, y, x, colour
    path = write(tool, 'film.nrrd', nrrd_header('u1', (3,) + SHAPE[::-1] + (2,), fields='kinds: RGB-color domain domain domain time\n'),
                 both.tobytes())
    tool.layout('NRRD', 'colours and time', f'{path}?field=blue', both[1, ..., 2], step=1, steps=2)
    steps = values('<i2', (4,) + SHAPE)
    for kinds in ('domain domain domain list', 'domain domain domain time', 'domain domain domain domain'):
        path = write(tool, 'steps.nrrd', nrrd_header('<i2', SHAPE[::-1] + (4,), fields=f'kinds: {kinds}\n'), steps.tobytes())
        tool.layout('NRRD', f'kinds {kinds}', path, steps[2], step=2, steps=4, result='steps')
    for i in range(4):
        steps[i].tofile(tool.path(f'part{i}.raw'))
    path = write(tool, 'parts.nhdr', nrrd_header('<i2', SHAPE[::-1] + (4,), fields='data file: part%d.raw 0 3 1\n'))
    tool.layout('NRRD', 'steps in files of their own (part%d.raw)', path, steps[3], step=3, steps=4)
    path = write(tool, 'first.nrrd', nrrd_header('<i2', (4,) + SHAPE[::-1], fields='kinds: list domain domain domain\n'), four.tobytes())
    tool.equal(path, four[..., 1], step=1, steps=4)
    for dtype, number in (('c8', 'f4'), ('c16', 'f8')):
        for order in '<>':
            parts = values(order + dtype)
            path = write(tool, 'complex.nrrd', nrrd_header(order + number, (2,) + SHAPE[::-1], fields='kinds: complex domain domain domain\n'), parts.tobytes())
            tool.typed('NRRD', kind_of(dtype), path, numpy.abs(parts))
    warned(tool, path, 'magnitude')
    image = SimpleITK.GetImageFromArray(steps, isVector=False)
    image.SetSpacing((1, 2, 3, 0.5))
    image.SetOrigin((7, 8, 9, 10))
    SimpleITK.WriteImage(image, tool.path('four.nrrd'))
    like_itk(tool, tool.path('four.nrrd'), step=2, steps=4, times=[10, 10.5, 11, 11.5])
    vector = SimpleITK.GetImageFromArray(values('f4', SHAPE + (2,)), isVector=True)
    SimpleITK.WriteImage(vector, tool.path('two.nrrd'))
    tool.equal(tool.path('two.nrrd') + '?field=component 2', values('f4', SHAPE + (2,))[..., 1])


def check_nrrd_small_files(tool):
    """A file that holds only a part of the components of a sample."""
    for i in range(32):
        write(tool, f'part{i}.raw', '', bytes(range(3)))
    names = ''.join(f'part{i}.raw\n' for i in range(32))
    path = write(tool, 'parts.nhdr', 'NRRD0004\ntype: uchar\ndimension: 4\nsizes: 3 2 4 4\nkinds: RGB-color list domain domain\nencoding: raw\n'
                 f'data file: LIST 1\n{names}')
    tool.refused(path, 'each of the 32 data files holds 3 bytes', 'write whole samples')


def check_nrrd_headers(tool):
    data = values('<i2')
    sizes = SHAPE[::-1]
    for fields in ('spacings: 1 -2 3\n', 'spacings: 1 NaN 3\n', 'spacings: 1 2 3\naxis mins: 10 20 30\n',
                   'spacings: 1 2 3\naxis mins: 10 20 30\ncenters: cell node ???\n', 'space: RAS\nspace directions: (0,2,0) (-1,0,0) (0,0,3)\nspace origin: (7,8,9)\n',
                   'space: LPS\nspace directions: (1,0,0) (0,-2,0) (0,0.5,3)\nspace origin: (1e9,8,-9e8)\n'):
        path = write(tool, 'place.nrrd', nrrd_header('<i2', sizes, fields=fields), data.tobytes())
        if '0.5' in fields:  # a sheared grid, which ITK refuses
            tool.equal(path, data, origin=[1e9, 8, -9e8], spacing=[1, 2, numpy.hypot(0.5, 3)])
        else:
            like_itk(tool, path, is_ras='RAS' in fields)
    warned(tool, write(tool, 'nan.nrrd', nrrd_header('<i2', sizes, fields='spacings: 1 NaN 3\n'), data.tobytes()), 'taken as 1')
    zero = write(tool, 'zero.nrrd', nrrd_header('<i2', sizes, fields='spacings: 1 0 3\n'), data.tobytes())
    tool.layout_refused('NRRD', 'spacings of 0', zero, 'is 0', 'spacings')
    warned(tool, write(tool, 'rest.nrrd', nrrd_header('<i2', sizes), data.tobytes() + b'rest'), '4 bytes after')
    like_itk(tool, tool.path('rest.nrrd'))
    tool.layout_refused('NRRD', 'fewer samples than the header says', write(tool, 'cut.nrrd', nrrd_header('<i2', sizes), data.tobytes()[:-1]), 'cut off')
    tool.layout_refused('NRRD', 'encoding zrl', write(tool, 'zrl.nrrd', nrrd_header('<i2', sizes, 'zrl'), data.tobytes()), 'zrl')
    block = nrrd_header('<i2', sizes).replace('type: short', 'type: block\nblock size: 2')
    tool.layout_refused('NRRD', 'type block', write(tool, 'block.nrrd', block, data.tobytes()), 'block')
    with open(tool.path('skip.raw'), 'wb') as file:
        file.write(b'one\ntwo\nxyz' + data.tobytes())
    for fields in ('byte skip: -1\n', 'line skip: 2\nbyte skip: 3\n'):
        path = write(tool, 'skip.nhdr', nrrd_header('<i2', sizes, fields=fields + 'data file: skip.raw\n'))
        like_itk(tool, path)
    with open(tool.path('skip.raw.gz'), 'wb') as file:
        file.write(gzip.compress(b'xyz' + data.tobytes()))
    tool.equal(write(tool, 'skip.nhdr', nrrd_header('<i2', sizes, 'gzip', 'byte skip: 3\ndata file: skip.raw.gz\n')), data)
    flat = write(tool, 'flat.nrrd', nrrd_header('<i2', sizes[:2]), data[0].tobytes())
    tool.equal(flat, data[:1])


# MetaImage

META = {'i1': 'MET_CHAR', 'u1': 'MET_UCHAR', 'i2': 'MET_SHORT', 'u2': 'MET_USHORT', 'i4': 'MET_INT', 'u4': 'MET_UINT', 'i8': 'MET_LONG_LONG',
        'u8': 'MET_ULONG_LONG', 'f4': 'MET_FLOAT', 'f8': 'MET_DOUBLE'}


def meta_header(dtype, more='', data='LOCAL', dims=SHAPE[::-1]):
    name = META.get(dtype.lstrip('<>'), dtype)
    return (f'ObjectType = Image\nNDims = {len(dims)}\nDimSize = {" ".join(map(str, dims))}\nElementByteOrderMSB = {dtype[0] == ">"}\n'
            f'{more}ElementType = {name}\nElementDataFile = {data}\n')


def check_metaimage(tool):
    for dtype in REALS:
        for ending in ('mha', 'mhd'):
            SimpleITK.WriteImage(SimpleITK.GetImageFromArray(values(dtype)), tool.path(f's.{ending}'), ending == 'mhd')
            like_itk(tool, tool.path(f's.{ending}'), unit='mm', compare=functools.partial(tool.typed, 'MetaImage', kind_of(dtype)))
        data = values('>' + dtype)
        like_itk(tool, write(tool, 'big.mha', meta_header('>' + dtype), data.tobytes()), compare=functools.partial(tool.typed, 'MetaImage', kind_of(dtype)))
        text = write(tool, 'text.mha', meta_header(dtype, 'BinaryData = False\n'), encode(data, 'ascii') + b'\n')
        tool.typed('MetaImage', kind_of(dtype), text, data, 'text (BinaryData = False)')
        tool.equal(write(tool, 'fractions.mha', meta_header(dtype, 'BinaryData = False\n'), b' '.join(b'%d.0' % n for n in range(data.size)) + b'\n'),
                   numpy.arange(data.size).reshape(data.shape))
    for size in (4, 8):
        for name, kind in (('MET_LONG', 'i'), ('MET_ULONG', 'u')):
            data = values(f'<{kind}{size}')
            tool.layout('MetaImage', f'{name} of {size} bytes, as the size of the file says', write(tool, 'long.mha', meta_header(name), data.tobytes()), data)
    warned(tool, tool.path('long.mha'), '8 bytes per number')
    data = values('<i2')
    for more in ('ElementSpacing = 1 -2 3\n', 'ElementSize = 2 3 4\n', 'Position = 1 2 3\nTransformMatrix = 0 1 0 -1 0 0 0 0 1\n',
                 'ElementSpacing = 2 3 4\nOffset = 1 2 3\nTransformMatrix = 0 0.5 0 -3 0 0 0 0.6 0.8\n',
                 'Origin = 1e7 2 -3\nElementSpacing = 0.001 0.002 1000\n', 'Offset = 1 2 3\nRotation = 0 0 1 0 1 0 1 0 0\n'):
        like_itk(tool, write(tool, 'place.mha', meta_header('<i2', more), data.tobytes()), unit='mm')
    for i in range(3):
        data[i].tofile(tool.path(f'slice{i}.raw'))
    for names in ('LIST\nslice0.raw\nslice1.raw\nslice2.raw', 'LIST 2D\nslice0.raw\nslice1.raw\nslice2.raw', 'slice%d.raw 0 2 1'):
        path = write(tool, 'list.mhd', meta_header('<i2', data=names))
        tool.layout('MetaImage', 'slices in files of their own: ' + names.split('\n', maxsplit=1)[0], path, data)
    data.tofile(tool.path('all.raw'))
    data.tofile(tool.path('head.raw'))
    with open(tool.path('head.raw'), 'wb') as file:
        file.write(b'header' + data.tobytes())
    for size in (-1, 6):
        like_itk(tool, write(tool, 'head.mhd', meta_header('<i2', f'HeaderSize = {size}\n', 'head.raw')))
    packed = write(tool, 'z.mha', meta_header('<i2', f'CompressedData = True\nCompressedDataSize = {len(zlib.compress(data.tobytes()))}\n'),
                   zlib.compress(data.tobytes()))
    like_itk(tool, packed, compare=functools.partial(tool.layout, 'MetaImage', 'zlib (CompressedData)'))
    for channels, names in ((3, ('red', 'green', 'blue')), (4, ('red', 'green', 'blue', 'alpha'))):
        colours = values('u1', SHAPE + (channels,))
        SimpleITK.WriteImage(SimpleITK.GetImageFromArray(colours, isVector=True), tool.path('rgb.mha'))
        for i, name in enumerate(names):
            tool.typed('MetaImage', ('RGB', 'RGBA')[channels - 3], tool.path('rgb.mha') + f'?field={name}', colours[..., i], name=name)
    steps = values('<u2', (3,) + SHAPE)
    image = SimpleITK.GetImageFromArray(steps, isVector=False)
    for ending in ('mha', 'mhd'):
        SimpleITK.WriteImage(image, tool.path(f'steps.{ending}'), ending == 'mha')
        like_itk(tool, tool.path(f'steps.{ending}'), step=1, steps=3, compare=functools.partial(tool.layout, 'MetaImage', 'four dimensions', result='steps'))
    for i in range(3):
        steps[i].tofile(tool.path(f'step{i}.raw'))
    path = write(tool, 'steps.mhd', meta_header('<u2', data='LIST 3D\nstep0.raw\nstep1.raw\nstep2.raw', dims=SHAPE[::-1] + (3,)))
    tool.layout('MetaImage', 'steps in files of their own: LIST 3D', path, steps[2], step=2, steps=3)
    tool.layout_refused('MetaImage', 'fewer samples than the header says', write(tool, 'cut.mha', meta_header('<i2'), data.tobytes()[:-2]), 'cut off')


# NIfTI

def nifti_file(tool, data, name='n.nii', kind=nibabel.Nifti1Image, affine=TURNED, edits=(), tail=b''):
    """Writes a file of nibabel, whose samples are x, y, z, …; `edits` then pack values at bytes of it."""
    image = kind(data, affine, dtype=data.dtype)
    image.set_qform(affine, 1)
    path = tool.path(name)
    image.to_filename(path)
    with open(path, 'rb') as file:
        content = bytearray(file.read())
    for at, form, *numbers in edits:
        struct.pack_into('<' + form, content, at, *numbers)
    if edits or tail:
        with open(path, 'wb') as file:
            file.write(content + tail)
    return path


def place(affine):
    """The grid of an affine map."""
    spacing = numpy.linalg.norm(affine[:3, :3], axis=0)
    return {'spacing': spacing.tolist(), 'direction': (affine[:3, :3] / spacing).ravel().tolist(), 'origin': affine[:3, 3].tolist()}


def like_nibabel(tool, path, step=0, compare=None, **wanted):
    image = nibabel.load(path)
    data = shown(numpy.asanyarray(image.dataobj))
    data = data.reshape(data.shape + (1,) * (3 - data.ndim))
    (compare or tool.equal)(path, (data[..., step] if data.ndim == 4 else data).T, step=step, **place(image.affine), **wanted)


def check_nifti_types(tool):
    for dtype in REALS + ('c8', 'c16'):
        for order in '<>':
            data = values(order + dtype).T
            for kind, ending in ((nibabel.Nifti1Image, 'nii'), (nibabel.Nifti2Image, 'nii.gz'), (nibabel.Nifti1Pair, 'hdr'),
                                 (nibabel.Nifti2Pair, 'hdr')):
                image = kind(data, TURNED, header=kind.header_class(endianness=order), dtype=data.dtype)
                image.to_filename(tool.path(f't.{ending}'))
                compare = functools.partial(tool.typed, 'NIfTI', kind_of(dtype), layout=f'{kind.__name__} of nibabel, .{ending}')
                like_nibabel(tool, tool.path(f't.{ending}'), compare=compare)
    for channels, names in (((('R', 'u1'), ('G', 'u1'), ('B', 'u1')), ('red', 'green', 'blue')),
                            ((('R', 'u1'), ('G', 'u1'), ('B', 'u1'), ('A', 'u1')), ('red', 'green', 'blue', 'alpha'))):
        colours = values('u1', SHAPE[::-1] + (len(names),))
        nibabel.Nifti1Image(colours.view(numpy.dtype(list(channels)))[..., 0], TURNED).to_filename(tool.path('rgb.nii'))
        for i, name in enumerate(names):
            tool.typed('NIfTI', ('RGB', 'RGBA')[len(names) - 3], tool.path('rgb.nii') + f'?field={name}', colours[..., i].T, name=name)
    for number, name in ((1, 'bits'), (1536, '16 bytes'), (2048, '16 bytes')):
        tool.layout_refused('NIfTI', f'datatype {number}', nifti_file(tool, values('i2').T, edits=[(70, 'h', number)]), name, 'datatype')


def check_nifti_shapes(tool):
    for shape in ((5,), (5, 4), (5, 4, 3), (5, 4, 3, 2)):
        like_nibabel(tool, nifti_file(tool, values('<i2', shape)))
    data = values('<i2', (5, 4, 3, 2, 3))
    path = nifti_file(tool, data)
    tool.layout('NIfTI', 'five dimensions', f'{path}?field=component 2', data[..., 1, 1].T, step=1, steps=2, result='steps and components')
    data = values('<i2', (5, 4, 3, 1, 2, 2, 2))
    tool.layout('NIfTI', 'seven dimensions', nifti_file(tool, data) + '?field=component 7', data[:, :, :, 0, 0, 1, 1].T, result='components')
    data = values('<i2', (5, 4, 3))
    for dims in ((3, 5, 4, 3, 0, 0, 0, 0), (4, 5, 4, 3, 0, 1, 1, 1), (5, 5, 4, 3, 1, 1, 0, 0)):
        tool.equal(nifti_file(tool, data, edits=[(40, '8h', *dims)]), data.T)
    like_nibabel(tool, nifti_file(tool, data, tail=b'rest'))


def check_nifti_scales(tool):
    data = values('<i2', (5, 4, 3))
    nan = float('nan')
    for slope, inter in ((2, -1), (0.5, 0), (-1, 3), (1, 0), (0, 5), (nan, nan), (nan, 5), (0, nan), (float('inf'), 0)):
        path = nifti_file(tool, data, edits=[(112, '2f', slope, inter)])
        like_nibabel(tool, path, compare=functools.partial(tool.layout, 'NIfTI', 'scl_slope, scl_inter; 0, NaN and infinite ones', result='as nibabel scales'))
    path = nifti_file(tool, data, edits=[(112, '2f', 2, nan)])
    tool.equal(path, 2.0 * data.T)
    warned(tool, path, 'scl_inter')


def turned(tool, path):
    """The place is TURNED, to the accuracy of a quaternion in float32."""
    info, _ = tool.dump(path)
    tool.checks += 1
    for key, value in place(TURNED).items():
        if info and not numpy.allclose(info[key], value, rtol=1e-5, atol=1e-5):
            tool.fail(path, f'{key} is {info[key]}, expected {value}')


def check_nifti_places(tool):
    data = values('<i2', (5, 4, 3))
    zero, singular = [0.0] * 12, [1.0, 0, 0, 5, 0, 0, 0, 6, 0, 0, 1, 7]
    for rows in (zero, singular, [float('nan')] * 12):
        path = nifti_file(tool, data, edits=[(280, '12f', *rows)])
        turned(tool, path)
        warned(tool, path, 'sform')
    turned(tool, nifti_file(tool, data, edits=[(252, '2h', 1, 0)]))
    turned(tool, nifti_file(tool, data, edits=[(252, '2h', 0, 2)]))
    turned(tool, nifti_file(tool, data, edits=[(256, '6f', *[float('nan')] * 6)]))
    path = nifti_file(tool, data, edits=[(252, '2h', 0, 0)])
    tool.equal(path, data.T, spacing=[1.5, 2, 3], origin=[0, 0, 0], anatomy='')
    path = nifti_file(tool, data, edits=[(268, '3f', 0, 0, 0)])
    turned(tool, path)  # the sform counts
    warned(tool, path, 'differently')
    for pixdim in ((1, -1.5, -2, -3, 0, 0, 0, 0), (-1, 1.5, 2, 3, 1, 1, 1, 1)):
        like_nibabel(tool, nifti_file(tool, data, edits=[(76, '8f', *pixdim), (252, '2h', 1, 0)]))
    path = nifti_file(tool, data, edits=[(76, '8f', 1, 0, 0, 0, 0, 0, 0, 0), (252, '2h', 0, 0)])
    tool.equal(path, data.T, spacing=[1, 1, 1])
    warned(tool, path, 'pixdim')
    for code, unit in ((1, 'm'), (2, 'mm'), (3, 'um')):
        tool.equal(nifti_file(tool, values('<i2', (5, 4, 3, 2)), edits=[(123, 'b', code | 16), (92, 'f', 250)]), values('<i2', (5, 4, 3, 2))[..., 1].T, step=1,
                   unit=unit, time_unit='ms', times=[0, 250])


def check_nifti_offsets(tool):
    data = values('<i2', (5, 4, 3))
    for offset in (0, 10, 348):
        for packed in (False, True):
            path = nifti_file(tool, data, edits=[(108, 'f', offset)])
            if packed:
                with open(path, 'rb') as file, gzip.open(path + '.gz', 'wb') as out:
                    out.write(file.read())
                path += '.gz'
            tool.layout('NIfTI', 'vox_offset inside of the header', path, data.T, result='read from its end, with a warning')
            warned(tool, path, 'vox_offset')
    path = nifti_file(tool, data, edits=[(108, 'f', 348)])
    with open(path, 'rb') as file:
        content = file.read()
    path = write(tool, 'short.nii', '', content[:348] + content[352:])
    tool.equal(path, data.T)
    path = write(tool, 'far.nii', '', content[:108] + struct.pack('<f', 400) + content[112:352] + bytes(48) + content[352:])
    like_nibabel(tool, path)
    tool.layout_refused('NIfTI', 'vox_offset behind the end', nifti_file(tool, data, edits=[(108, 'f', 1e6)]), 'cut off')
    tool.refused(nifti_file(tool, data, edits=[(108, 'f', -5)]), 'vox_offset')
    tool.refused(write(tool, 'cut.nii', '', content[:-1]), 'cut off')


def check_analyze(tool):
    data = values('<i2', (5, 4, 3))
    for kind in (nibabel.AnalyzeImage, nibabel.Spm99AnalyzeImage):
        image = kind(data, None)
        image.header.set_zooms((1.5, 2, 3))
        image.to_filename(tool.path('a.img'))
        tool.layout('NIfTI', f'ANALYZE 7.5 ({kind.__name__} of nibabel)', tool.path('a.hdr'), data.T, spacing=[1.5, 2, 3], unit='mm', anatomy='',
                    result='read, without left and right')
        warned(tool, tool.path('a.hdr'), 'left and right')
    write(tool, 'a.mat', '', bytes(128))  # as SPM has the place beside the image
    warned(tool, tool.path('a.hdr'), 'a.mat, which is not read')


# MRC

def check_mrc(tool):
    for mode, dtype in ((0, 'i1'), (1, 'i2'), (2, 'f4'), (4, 'c8'), (6, 'u2'), (12, 'f2')):
        for order in '<>':
            for ending in ('mrc', 'map', 'rec', 'st', 'ccp4', 'mrcs', 'mrc.gz'):
                if ending not in ('mrc', 'mrc.gz') and mode != 2:
                    continue
                path = tool.path(f'{mode}.{ending}')
                data = values(order + dtype)
                with mrcfile.new(path, overwrite=True, compression='gzip' if ending.endswith('gz') else None) as file:
                    file.set_data(data)
                    file.voxel_size = (0.75, 0.5, 2)
                    file.header.origin.x, file.header.origin.y, file.header.origin.z = 1, 2, 3
                    file.set_extended_header(numpy.zeros(40, 'V4'))
                tool.typed('MRC', kind_of(dtype), path, shown(data), f'.{ending}', spacing=[0.75, 0.5, 2], origin=[1, 2, 3], unit='angstrom')
    path = tool.path('axes.mrc')
    data = values('f4')
    with mrcfile.new(path, overwrite=True) as file:
        file.set_data(data)
        file.voxel_size = (0.75, 0.5, 2)
        file.header.mapc, file.header.mapr, file.header.maps = 3, 1, 2  # columns run along z
        file.header.mx, file.header.my, file.header.mz = 4, 3, 5
        file.header.cella = (3, 1.5, 10)
        file.header.nxstart, file.header.nystart, file.header.nzstart = 1, 2, 3
    tool.layout('MRC', 'columns along z (MAPC, MAPR, MAPS)', path, data, spacing=[2, 0.75, 0.5], direction=[0, 1, 0, 0, 0, 1, 1, 0, 0], origin=[1.5, 1.5, 2])
    volumes = values('f4', (2,) + SHAPE)
    with mrcfile.new(tool.path('stack.mrc'), overwrite=True) as file:
        file.set_data(volumes)
    tool.layout('MRC', 'a stack of volumes (space group 401)', tool.path('stack.mrc'), volumes[1], step=1, steps=2, result='steps')
    # IMOD's origin has the other sign, unless flag 4 is set or the file says MRC2014; mode 0 may have 4 bits (flag 16).
    for flags, version, sign in ((0, 0, -1), (4, 0, 1), (0, 20140, 1), (1, 20141, 1)):
        with mrcfile.new(tool.path('imod.mrc'), overwrite=True) as file:
            file.set_data(data)
            file.header.origin.x, file.header.origin.y, file.header.origin.z = 1, -2, 3
            file.header.nversion = version
        with open(tool.path('imod.mrc'), 'r+b') as file:
            file.seek(152)
            file.write(struct.pack('<2i', 1146047817, flags))
        tool.equal(tool.path('imod.mrc'), data, origin=[sign, -2 * sign, 3 * sign])
    tool.refused(write(tool, 'bad.mrc', '', bytes(1024)), 'no MRC file')
    with open(path, 'rb') as file:
        content = file.read()
    tool.layout_refused('MRC', 'fewer samples than the header says', write(tool, 'cut.mrc', '', content[:-1]), 'cut off')
    tool.layout_refused('MRC', '4 bits (mode 101)', write(tool, 'mode.mrc', '', content[:12] + struct.pack('<i', 101) + content[16:]), 'mode 101')
    half = content[:12] + struct.pack('<i', 0) + content[16:152] + struct.pack('<2i', 1146047817, 16) + content[160:]
    tool.layout_refused('MRC', '4 bits (mode 0 and flag 16 of IMOD)', write(tool, 'half.mrc', '', half), 'mode 0 with samples of 4 bits')
    tool.refused(write(tool, 'extended.mrc', '', content[:92] + struct.pack('<i', -5) + content[96:]), 'the extended header has -5 bytes')


def check_gipl(tool):
    for dtype in ('i1', 'u1', 'i2', 'u2', 'f4', 'f8'):
        image = SimpleITK.GetImageFromArray(values(dtype))
        image.SetSpacing((0.5, 2, 3))
        image.SetOrigin((7, 8, 9))
        for ending in ('gipl', 'gipl.gz'):
            try:
                SimpleITK.WriteImage(image, tool.path(f'g.{ending}'))
            except RuntimeError:  # ITK does not write this type
                continue
            like_itk(tool, tool.path(f'g.{ending}'), unit='mm', compare=functools.partial(tool.typed, 'GIPL', kind_of(dtype)))


def check_minc(tool):
    """MINC is refused: without the scales of its slices the array would be wrong."""
    with h5py.File(tool.path('two.mnc'), 'w') as file:
        file['minc-2.0/image/0/image'] = values('i2')
    tool.refused(tool.path('two.mnc'), 'mnc2nii')
    with netCDF4.Dataset(tool.path('one.mnc'), 'w', format='NETCDF3_CLASSIC') as file:
        for name, size in zip(('zspace', 'yspace', 'xspace'), SHAPE):
            file.createDimension(name, size)
        file.createVariable('rootvariable', 'i4')
        file.createVariable('image', 'i2', ('zspace', 'yspace', 'xspace'))[:] = values('i2')
    tool.refused(tool.path('one.mnc'), 'mnc2nii')


def check_mgh(tool):
    """MGH of FreeSurfer against nibabel: the anatomy of a file is RAS, the world of a view the same."""
    for ending in ('.mgh', '.mgz'):
        for dtype in ('u1', 'i2', 'i4', 'f4', 'u2'):
            data, path = values(dtype), tool.path('volume' + ending)
            image = nibabel.MGHImage(data.T, TURNED)
            if dtype == 'u2':  # nibabel does not write them
                image = nibabel.MGHImage(data.view('i2').T, TURNED)
            nibabel.save(image, path)
            if dtype == 'u2':
                with (gzip.open if ending == '.mgz' else open)(path, 'rb') as file:
                    content = bytearray(file.read())
                content[23] = 10
                with (gzip.open if ending == '.mgz' else open)(path, 'wb') as file:
                    file.write(content)
            tool.typed('MGH', kind_of(dtype), path, data, ending, spacing=[1.5, 2, 3], unit='mm', anatomy='RAS', origin=list(TURNED[:3, 3]),
                       direction=[0, -1, 0, 1, 0, 0, 0, 0, 1])
    steps = values('f4', (2, *SHAPE))
    path = tool.path('frames.mgz')
    nibabel.save(nibabel.MGHImage(steps.T, TURNED), path)
    tool.layout('MGH', 'several frames', path, steps[1], step=1, result='steps', steps=2)
    for ending in ('.mgh', '.mgz'):
        image = nibabel.MGHImage(steps.T, TURNED)
        image.header['tr'] = 2000
        nibabel.save(image, tool.path('tr' + ending))
        tool.equal(tool.path('tr' + ending), steps[1], step=1, steps=2, times=[0, 2000], time_unit='ms')
    header = struct.pack('>7ih', 1, 5, 4, 3, 1, 3, 0, 0) + bytes(254)
    path = write(tool, 'unplaced.mgh', '', header + values('f4').astype('>f4').tobytes())
    tool.layout('MGH', 'no place (goodRASFlag 0)', path, values('f4'), result='coronal, with a warning', warned='coronal', origin=[2.5, -1.5, 2],
                direction=[-1, 0, 0, 0, 0, 1, 0, -1, 0])
    # Directions that are not exactly of length 1 scale the spacing, as nibabel multiplies both.
    with open(write(tool, 'scaled.mgh', '', header), 'r+b') as file:
        file.seek(28)
        file.write(struct.pack('>h15f', 1, 2, 3, 4, 0, -0.99995, 0, 1, 0, 0, 0, 0, 1.25, 10, 20, 30) + bytes(194) + values('f4').astype('>f4').tobytes())
    tool.equal(tool.path('scaled.mgh'), values('f4'), **place(nibabel.load(tool.path('scaled.mgh')).affine))
    nibabel.save(nibabel.MGHImage(numpy.zeros((100000, 1, 1), 'f4'), numpy.eye(4)), tool.path('curv.mgh'))
    tool.layout_refused('MGH', 'values of a surface', tool.path('curv.mgh'), 'nodes of a surface')
    write(tool, 'cut.mgh', '', header + bytes(60))
    tool.layout_refused('MGH', 'fewer samples than the header says', tool.path('cut.mgh'), 'cut off')


def check_packed(tool):
    """A packed file that is damaged, cut off or continued says so, whichever step is read and whatever its header allows after the samples."""
    steps = values('f4', (3, *SHAPE))
    files = {'one.nii.gz': nibabel.Nifti1Image(steps[0].T, TURNED), 'steps.nii.gz': nibabel.Nifti1Image(steps.T, TURNED),
             'one.mgz': nibabel.MGHImage(steps[0].T, TURNED), 'steps.mgz': nibabel.MGHImage(steps.T, TURNED)}
    for name, image in files.items():
        nibabel.save(image, tool.path(name))
    with mrcfile.new(tool.path('one.mrc.gz'), compression='gzip', overwrite=True) as file:
        file.set_data(steps[0])
    nrrd.write(tool.path('steps.nrrd'), steps.T, {'encoding': 'gzip', 'kinds': ['domain', 'domain', 'domain', 'time']})
    for name in (*files, 'one.mrc.gz', 'steps.nrrd'):
        path, count = tool.path(name), 3 if 'steps' in name else 1
        with open(path, 'rb') as file:
            content = file.read()
        for step in range(count):
            tool.equal(path, steps[step], step=step)
            for at in (-5, -60):  # of the length, and of the last samples
                damaged = bytearray(content)
                damaged[at] ^= 0x55
                tool.refused_step(write(tool, name, '', bytes(damaged)), step, 'gzip data is')
            tool.refused_step(write(tool, name, '', content[:-4]), step, 'the gzip data is cut off')
            tool.equal(write(tool, name, '', content + bytes(512)), steps[step], step=step)
            tool.equal(write(tool, name, '', content + b'tail'), steps[step], step=step, warned='other bytes after its gzip data')
            write(tool, name, '', content)
    packed = gzip.compress(gzip.decompress(open(tool.path('steps.nii.gz'), 'rb').read())[:-SHAPE[0] * SHAPE[1] * SHAPE[2] * 4])
    tool.refused_step(write(tool, 'short.nii.gz', '', packed), 0, 'it is cut off or dim is wrong')


def check(tool):
    warnings.simplefilter('ignore')
    SimpleITK.ProcessObject.SetGlobalWarningDisplay(False)
    for part in (check_nrrd_types, check_nrrd_layouts, check_nrrd_small_files, check_nrrd_headers, check_metaimage, check_nifti_types, check_nifti_shapes,
                 check_nifti_scales, check_nifti_places, check_nifti_offsets, check_analyze, check_mrc, check_gipl, check_mgh, check_minc,
                 check_packed):
        part(tool)
        for name in os.listdir(tool.folder):
            path = tool.path(name)
            if os.path.isfile(path):
                os.remove(path)
