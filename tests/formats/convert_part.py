# SPDX-License-Identifier: Apache-2.0
"""What `splatctl convert` writes: read again by the daemon's reader, and by nibabel, pynrrd, zarr and OpenVDB."""
import json
import os
import shutil
import subprocess

import nibabel
import nrrd
import numpy
import zarr

from ramp import ramp

TYPES = {'uint8': 'uint8', 'int8': 'int8', 'uint16': 'uint16', 'int16': 'int16', 'int32': 'int32', 'float32': 'float', 'float64': 'double'}
TURNED = numpy.array([[0, -1, 0], [0.6, 0, 0.8], [0.8, 0, -0.6]])  # columns: the directions of the axes; left-handed

OPENVDB = ['/usr/bin/python3']  # python3-openvdb is a module of the system's Python

SPACES = ['left-posterior-superior', 'right-anterior-superior', 'left-anterior-superior', '3D-right-handed']
DIRECTIONS = [TURNED, numpy.eye(3), TURNED[:, [1, 0, 2]], numpy.array([[0.8, 0.6, 0], [0.6, 0.8, 0], [0, 0, 1]])]  # the last are not perpendicular


def write_source(tool, name, dtype, space='left-posterior-superior', directions=TURNED, unit='mm'):
    """A NRRD file, made here: (path, samples as z, y, x)."""
    data = ramp((9, 70, 131), dtype)
    vectors = ' '.join('(' + ','.join(repr(float(n)) for n in directions[:, a] * s) + ')' for a, s in enumerate((0.5, 1.25, 3)))
    lines = ['NRRD0005', f'type: {TYPES[dtype]}', 'dimension: 3', 'sizes: 131 70 9', 'encoding: raw', 'endian: little', f'space: {space}',
             f'space directions: {vectors}', 'space origin: (10.5,-20,0.1)', f'space units: "{unit}" "{unit}" "{unit}"', 'content: density of "µ"',
             'sample units: HU', '', '']
    with open(tool.path(name), 'wb') as file:
        file.write('\n'.join(lines).encode() + data.astype(data.dtype.newbyteorder('<')).tobytes())
    return tool.path(name), data


def convert(tool, source, name):
    out = tool.path(name)
    done = subprocess.run([tool.splatctl, 'convert', source, out], capture_output=True, text=True, check=False)
    tool.checks += 1
    if done.returncode != 0:
        tool.fail(source, f'convert to {name}: {done.stderr.strip()}')
    return out


def same(tool, path, what, got, expected):
    tool.checks += 1
    if not numpy.allclose(got, expected, rtol=1e-6, atol=1e-6):
        tool.fail(path, f'{what} is\n{got}\nexpected\n{expected}')


def affine_of(info, factor=1):
    affine = numpy.eye(4)
    affine[:3, :3] = numpy.reshape(info['direction'], (3, 3)) * info['spacing'] * factor
    affine[:3, 3] = numpy.array(info['origin']) * factor
    return affine


def check_nrrd(tool, dtype):
    for space in SPACES if dtype == 'int16' else SPACES[:1]:
        source, data = write_source(tool, 'source.nrrd', dtype, space)
        info, _ = tool.dump(source)
        out = convert(tool, source, 'out.nrrd')
        tool.equal(out, data, **{key: info[key] for key in ('spacing', 'origin', 'direction', 'unit', 'anatomy', 'name', 'value_unit', 'type')})
        samples, header = nrrd.read(out)
        tool.checks += 1
        if not numpy.array_equal(samples.T, data):
            tool.fail(out, 'pynrrd reads other samples')
        affine = affine_of(info)
        same(tool, out, 'space directions', numpy.array(header['space directions']).T, affine[:3, :3])
        same(tool, out, 'space origin', header['space origin'], affine[:3, 3])


def check_nifti(tool, dtype):
    flip = numpy.diag([-1, -1, 1, 1])  # LPS to RAS
    for unit, name, factor, shown in (('mm', 'out.nii', 1, 'mm'), ('um', 'out.nii.gz', 1, 'um'), ('nm', 'out.nii', 1e-3, 'um')):
        for directions in DIRECTIONS if dtype == 'int16' else DIRECTIONS[:1]:
            source, data = write_source(tool, 'source.nrrd', dtype, directions=directions, unit=unit)
            info, _ = tool.dump(source)
            out = convert(tool, source, name)
            affine = flip @ affine_of(info, factor)
            tool.equal(out, data, unit=shown, anatomy='RAS', name='density of "µ"', type=info['type'])
            image = nibabel.load(out)
            samples = numpy.asanyarray(image.dataobj)
            tool.checks += 1
            if samples.dtype != data.dtype or not numpy.array_equal(samples.T, data):
                tool.fail(out, f'nibabel reads other samples, of type {samples.dtype}')
            same(tool, out, 'the affine', image.affine, affine)
            same(tool, out, 'the grid', affine_of(tool.dump(out)[0]), affine)
            same(tool, out, 'the unit', image.header.get_xyzt_units()[0] == {'mm': 'mm', 'um': 'micron'}[shown], True)
            form, code = image.header.get_qform(coded=True)
            same(tool, out, 'the code of qform', code, 0 if directions[1, 0] == 0.6 and directions[1, 1] == 0.8 else 1)
            if code:
                same(tool, out, 'qform', form, affine)


def check_vdb(tool, dtype):
    """The daemon's reader is OpenVDB behind OpenImageIO; its Python module reads what that hides."""
    for directions in DIRECTIONS if dtype == 'int16' else DIRECTIONS[:1]:
        source, data = write_source(tool, 'source.nrrd', dtype, directions=directions)
        affine = affine_of(tool.dump(source)[0])
        out = convert(tool, source, 'out.vdb')
        tool.equal(out, data.astype('f4'), name='density of "µ"', type='float32', unit='', anatomy='')
        same(tool, out, 'the grid', affine_of(tool.dump(out)[0]), affine)
        if not tool.has_openvdb:
            continue
        done = subprocess.run([*OPENVDB, os.path.join(os.path.dirname(__file__), 'vdb_read.py'), out, tool.path('vdb.raw')], capture_output=True, text=True, check=False)
        if done.returncode != 0:
            tool.fail(out, f'OpenVDB does not read it: {done.stderr}')
            continue
        about = json.loads(done.stdout)
        shape = data.T.shape
        last = [n - 1 for n in shape]
        same(tool, out, 'the samples of OpenVDB', numpy.fromfile(tool.path('vdb.raw'), 'f4').reshape(shape), data.T)
        same(tool, out, 'the world of OpenVDB', numpy.array(about['world']), numpy.array([affine[:3, 3], *(affine[:3, 3] + affine[:3, a] for a in range(3))]))
        same(tool, out, 'the box', about['box'] + [about['first']], [[0, 0, 0], last, [0, 0, 0]])
        active = numpy.count_nonzero(data.astype('f4')) + (data[0, 0, 0] == 0) + (data[-1, -1, -1] == 0)
        same(tool, out, f'the description {about}', [about['name'], about['class'], about['type'], about['creator'], about['background'], about['active']] ==
             ['density of "µ"', 'fog volume', 'FloatGrid', 'splatctl convert', 0, active], True)


def check_wide(tool):
    data = ramp((1, 2, 40000), 'uint8')
    with open(tool.path('wide.nrrd'), 'wb') as file:
        file.write(b'NRRD0004\ntype: uint8\ndimension: 3\nsizes: 40000 2 1\nspacings: 0.1 0.2 3\nencoding: raw\n\n' + data.tobytes())
    out = convert(tool, tool.path('wide.nrrd'), 'wide.nii')
    image = nibabel.load(out)
    tool.equal(out, data, spacing=[0.1, 0.2, 3], unit='', anatomy='')
    same(tool, out, 'that this is NIfTI-2', isinstance(image, nibabel.Nifti2Image), True)
    same(tool, out, 'the samples', numpy.array_equal(numpy.asanyarray(image.dataobj).T, data), True)


def halved(data):
    """The means of 2 x 2 x 2 samples, of fewer at odd ends; whole numbers are rounded to even."""
    total, count = data.astype('f8'), numpy.ones(data.shape)
    for axis in range(3):
        at = numpy.arange(0, total.shape[axis], 2)
        total, count = numpy.add.reduceat(total, at, axis=axis), numpy.add.reduceat(count, at, axis=axis)
    return total / count if data.dtype.kind == 'f' else numpy.rint(total / count).astype(data.dtype)


def check_zarr(tool, dtype):
    source, data = write_source(tool, 'source.nrrd', dtype, directions=numpy.eye(3), unit='um')
    out = convert(tool, source, 'out.ome.zarr')
    tool.equal(out, data, unit='um', anatomy='LPS', name='density of "µ"', spacing=[0.5, 1.25, 3], origin=[10.5, -20, 0.1], type=dtype)
    image = zarr.open_group(out, mode='r')
    multiscale = image.attrs['multiscales'][0]
    axes = [{'name': n, 'type': 'space', 'unit': 'micrometer', 'orientation': {'type': 'anatomical', 'value': v}} for n, v in
            (('z', 'inferior-to-superior'), ('y', 'anterior-to-posterior'), ('x', 'right-to-left'))]
    same(tool, out, 'what the metadata say', multiscale['version'] == '0.4' and multiscale['name'] == 'source' and multiscale['axes'] == axes, True)
    same(tool, out, 'the window', [image.attrs['omero']['channels'][0]['window'][k] for k in ('min', 'max')], [data.min(), data.max()])
    level, centre = data, numpy.zeros(3)
    for i, dataset in enumerate(multiscale['datasets']):
        array = image[dataset['path']]
        same(tool, out, f'the samples of level {i}', array.dtype == data.dtype and array.shape == level.shape and
             numpy.allclose(array[...], level, rtol=1e-6), True)
        factor = 2.0 ** i
        scale, translation = dataset['coordinateTransformations']
        same(tool, out, 'the scale', scale['scale'], numpy.array([3, 1.25, 0.5]) * factor)
        same(tool, out, 'the translation', translation['translation'], numpy.array([0.1, -20, 10.5]) + centre * [3, 1.25, 0.5])
        tool.equal(f'{out}?level={i}', array[...], spacing=[0.5 * factor, 1.25 * factor, 3 * factor])
        level, centre = halved(level), numpy.full(3, (2.0 ** (i + 1) - 1) / 2)
    same(tool, out, 'the number of levels', len(multiscale['datasets']), 3)


def patient_affine(info):
    """The place of samples in RAS, whatever the order of the axes of the world."""
    turn = numpy.eye(4)
    turn[:3, :3] = [[(letter == to) - (letter == away) for letter in info['anatomy']] for to, away in ('RL', 'AP', 'SI')]
    return turn @ affine_of(info)


def check_quarter_turns(tool):
    """Axes along the axes of the patient: the place of every sample in RAS stays."""
    for space in ('right-anterior-superior', 'left-posterior-superior'):
        for directions in ([[-1, 0, 0], [0, 1, 0], [0, 0, 1]], [[0, 0, -1], [1, 0, 0], [0, 1, 0]], [[0, 1, 0], [0, 0, -1], [1, 0, 0]]):
            source, data = write_source(tool, 'source.nrrd', 'uint8', space, numpy.array(directions, float))
            out = convert(tool, source, 'turned.zarr')
            tool.equal(out, data)
            places = [patient_affine(info) for info in (tool.dump(source)[0], tool.dump(out)[0])]
            same(tool, out, 'the place', places[1], places[0])


def check_folders(tool):
    source, data = write_source(tool, 'source.nrrd', 'uint8', directions=numpy.eye(3))
    out = convert(tool, source, 'twice.zarr')
    convert(tool, source, 'twice.zarr/')  # replaces what it wrote
    tool.equal(out, data)
    with open(os.path.join(out, 'notes.txt'), 'w', encoding='utf-8') as file:
        file.write('mine')
    other = tool.path('other.zarr')
    zarr.create_array(other, shape=(2, 2, 2), dtype='u1')
    turned, _ = write_source(tool, 'turned.nrrd', 'uint8')
    for name, path, word in ((source, out, 'did not write'), (source, other, 'did not write'), (turned, tool.path('new.zarr'), 'turned')):
        done = subprocess.run([tool.splatctl, 'convert', name, path], capture_output=True, text=True, check=False)
        same(tool, path, f'that it is refused: {done.stderr.strip()}', done.returncode == 1 and word in done.stderr, True)
    same(tool, out, 'that nothing is left', any('.part' in name for name in os.listdir(tool.folder)) or os.path.exists(tool.path('new.zarr')), False)
    shutil.rmtree(out)
    empty = numpy.zeros((70, 70, 70), 'u1')
    with open(tool.path('empty.nrrd'), 'wb') as file:
        file.write(b'NRRD0004\ntype: uint8\ndimension: 3\nsizes: 70 70 70\nencoding: raw\n\n' + empty.tobytes())
    out = convert(tool, tool.path('empty.nrrd'), 'empty.zarr')
    tool.equal(out, empty, unit='', name='')
    same(tool, out, 'that zeros have no files', sum(len(files) for _, _, files in os.walk(out)), 6)


def check_what_is_left_out(tool):
    """A warning says what the output does not have."""
    data = ramp((2, 3, 4, 5, 6), 'uint16')
    group = zarr.open_group(tool.path('series.zarr'), mode='w', zarr_format=2, attributes={'multiscales': [
        {'version': '0.4', 'datasets': [{'path': '0', 'coordinateTransformations': [{'type': 'scale', 'scale': [1, 1, 1, 1, 1]}]}],
         'axes': [{'name': n, 'type': t} for n, t in (('t', 'time'), ('c', 'channel'), ('z', 'space'), ('y', 'space'), ('x', 'space'))]}]})
    group.create_array('0', data=data)
    source, out = tool.path('series.zarr?field=channel 2'), tool.path('one.nii')
    done = subprocess.run([tool.splatctl, 'convert', source, out], capture_output=True, text=True, check=False)
    tool.equal(out, data[0, 1], name='channel 2')
    same(tool, source, f'the warnings: {done.stderr}', 'of 2 time steps' in done.stderr and 'only "channel 2"' in done.stderr, True)


def check(tool):
    tool.has_openvdb = subprocess.run([*OPENVDB, '-c', 'import numpy, pyopenvdb'], capture_output=True, check=False).returncode == 0
    if not tool.has_openvdb:
        tool.skipped.append('OpenVDB by itself: not installed: python3-openvdb')
    tool.splatctl = os.path.join(os.path.dirname(tool.dump_program), '..', 'bin', 'splatctl')
    for dtype in TYPES:
        check_nrrd(tool, dtype)
        check_nifti(tool, dtype)
        check_zarr(tool, dtype)
        check_vdb(tool, dtype)
    check_wide(tool)
    check_folders(tool)
    check_what_is_left_out(tool)
    check_quarter_turns(tool)
