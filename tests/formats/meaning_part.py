# SPDX-License-Identifier: Apache-2.0
"""What the numbers of a file mean: intents of NIfTI, components, ?as=, ?unit=, Hounsfield units."""
import struct

import h5py
import netCDF4
import nibabel
import nrrd
import numpy
import pydicom
import SimpleITK
import tifffile
import zarr

import dicom_files

SHAPE = (7, 6, 5)  # x, y, z


def field(seed, *more):
    return numpy.random.default_rng(seed).normal(size=(*SHAPE, *more)).astype('f4')


def directions(seed):
    """Unit vectors, with some voxels outside of the brain."""
    v = field(seed, 3)
    v /= numpy.linalg.norm(v, axis=-1, keepdims=True)
    v[0] = 0
    return v.astype('f4')


def write_nifti(tool, name, data, intent=None, affine=None, intent_name=''):
    image = nibabel.Nifti1Image(data, numpy.diag([2, 2, 2, 1.0]) if affine is None else affine)
    if intent is not None:
        image.header.set_intent(intent, allow_unknown=True, name=intent_name)
    path = tool.path(name)
    nibabel.save(image, path)
    return path


def says(tool, source, **wanted):
    """Members of the description."""
    info, _ = tool.dump(source)
    tool.checks += 1
    for key, value in wanted.items():
        got = [info[f'other{i}'] for i in range(16) if f'other{i}' in info] if info and key == 'others' else (info or {}).get(key)
        if info and got != value:
            tool.fail(source, f'{key} is {got!r}, expected {value!r}')


def warns(tool, source, words):
    info, _ = tool.dump(source)
    tool.checks += 1
    if info and words not in ' | '.join(info['warnings']):
        tool.fail(source, f'expected the warning "{words}", got {info["warnings"]}')


def has_vectors(tool, source, expected, sep='?'):
    """The vectors along the axes of the world, x, y, z, component."""
    for i, name in enumerate('xyz'):
        info, samples = tool.dump(f'{source}{sep}field={name}')
        tool.checks += 1
        if info is None:
            continue
        if not info['vectors'] or info['steps'] != 1:
            tool.fail(source, f'has no vectors, but {info["steps"]} steps')
        elif not numpy.allclose(samples.T, expected[..., i], atol=1e-6):
            tool.fail(source, f'component {name} of the vectors differs')


def check_nifti_vectors(tool):
    v = directions(1)
    turned = numpy.array([[0, -2, 0, 10], [2, 0, 0, -20], [0, 0, 2, 30], [0, 0, 0, 1.0]])
    for name in ('a_V1.nii', 'a_V1.nii.gz', 'V3.nii'):
        for affine in (numpy.diag([-2, 2, 2, 1.0]), numpy.diag([2, 2, 2, 1.0]), turned):
            path = write_nifti(tool, name, v, affine=affine)
            own = v.copy()
            if numpy.linalg.det(affine) > 0:  # FSL's first axis points to the left
                own[..., 0] *= -1
            has_vectors(tool, path, own @ (affine[:3, :3] / 2).T)
    has_vectors(tool, write_nifti(tool, 'unit.nii.gz', v), v)
    says(tool, tool.path('unit.nii.gz') + '?as=time', steps=3, vectors='')
    for intent in (1006, 1007):
        path = write_nifti(tool, 'v.nii', field(2, 1, 3), intent)
        has_vectors(tool, path, field(2, 1, 3)[..., 0, :])
        path = write_nifti(tool, 'v4.nii', field(2, 3), intent)
        has_vectors(tool, path, field(2, 3))
    for affine in (numpy.diag([-2, 2, 2, 1.0]), numpy.diag([2, 2, 2, 1.0]), turned):  # vectors of FNIRT lie along the axes of the grid, as vectors of dtifit do
        own = field(2, 3)
        if numpy.linalg.det(affine) > 0:
            own[..., 0] *= -1
        path = write_nifti(tool, 'fnirt.nii', field(2, 3), 2006, affine=affine)
        has_vectors(tool, path, own @ (affine[:3, :3] / 2).T)
        warns(tool, path, 'relative displacements of FSL')
    # Three volumes that are no directions stay steps.
    path = write_nifti(tool, 'steps.nii', field(3, 3))
    says(tool, path, steps=3, vectors='')
    has_vectors(tool, path + '?as=vectors', field(3, 3), sep='&')
    tool.equal(path + '?as=channels&field=component 2', field(3, 3)[..., 1].T, name='component 2')
    says(tool, path + '?as=rgb', name='red', others=['green', 'blue'], steps=1)
    tool.refused(write_nifti(tool, 'four.nii', field(3, 4)) + '?as=vectors', '4 numbers per voxel', 'time, rgb, channels or labels')
    tool.refused(write_nifti(tool, 'one.nii', field(3)) + '?as=time', 'one number per voxel', 'labels')
    says(tool, write_nifti(tool, 'five.nii', field(3, 1, 5)), steps=1, name='component 1')
    says(tool, tool.path('five.nii') + '?as=time', steps=5)
    says(tool, write_nifti(tool, 'both.nii', field(3, 2, 3)), steps=2, name='component 1')
    tool.refused(tool.path('both.nii') + '?as=vectors', '3 numbers per voxel')


def check_nifti_scaled_vectors(tool):
    """scl_slope and scl_inter also apply to vectors; the directions of FSL may be whole numbers or shifted."""
    raw = numpy.random.default_rng(2).integers(-900, 900, size=(*SHAPE, 1, 3)).astype('i2')
    path = write_nifti(tool, 'scaled.nii', raw, 1007)
    set_slope(path, 0.01, 5)
    has_vectors(tool, path, nibabel.load(path).get_fdata()[..., 0, :])
    unit = directions(1)
    path = write_nifti(tool, 'shifted.nii', (unit - numpy.float32(0.5)) * 2)
    set_slope(path, 0.5, 0.5)
    has_vectors(tool, path, unit)


def set_slope(path, slope, inter):
    """Into a header of NIfTI-1, since nibabel would rescale the samples."""
    with open(path, 'r+b') as file:
        file.seek(112)
        file.write(struct.pack('<2f', slope, inter))


def check_nifti_intents(tool):
    for intent, name, meaning in (('t test', 't statistic', 'statistic'), ('z score', 'z score', 'statistic'), ('f test', 'F statistic', 'statistic'),
                                  ('correlation', 'correlation', 'statistic'), ('p value', 'p value', ''), ('estimate', 'estimate', 'statistic'),
                                  ('label', 'label', 'labels'), ('neuroname', 'neuroname', 'labels')):
        says(tool, write_nifti(tool, 'i.nii', numpy.abs(field(4)).round(), intent), name=name, meaning=meaning)
    says(tool, write_nifti(tool, 'i.nii', field(4), 'z score', intent_name='motor'), name='motor', meaning='statistic')
    says(tool, write_nifti(tool, 'm.nii', field(4, 1, 6), 1005), name='xx', others=['xy', 'yy', 'xz', 'yz', 'zz'], steps=1)
    tool.equal(tool.path('m.nii') + '?field=xz', field(4, 1, 6)[..., 0, 3].T)
    says(tool, write_nifti(tool, 'dti_tensor.nii.gz', field(4, 6)), name='xx', others=['xy', 'xz', 'yy', 'yz', 'zz'], steps=1)
    says(tool, write_nifti(tool, 'rgb.nii', numpy.zeros((*SHAPE, 1, 3), 'u1'), 2003), name='red', others=['green', 'blue'])
    says(tool, write_nifti(tool, 'rgba.nii', numpy.zeros((*SHAPE, 1, 4), 'u1'), 2004), name='red', others=['green', 'blue', 'alpha'])
    says(tool, write_nifti(tool, 'series.nii', field(4, 1, 4), 2001), steps=4)
    says(tool, write_nifti(tool, 'labels.nii', numpy.zeros(SHAPE, 'i2')) + '?as=labels', meaning='labels')
    says(tool, tool.path('labels.nii') + '?unit=um', unit='um')


def check_nifti_others(tool):
    """Files without a volume, and fourth axes that are no time."""
    model = nibabel.cifti2.BrainModelAxis.from_mask(numpy.ones((4, 4, 3)), affine=numpy.eye(4), name='thalamus_left')
    path = tool.path('c.dscalar.nii')
    image = nibabel.Cifti2Image(numpy.ones((2, 48), 'f4'), header=(nibabel.cifti2.ScalarAxis(['a', 'b']), model))
    for intent in (3000, 3001, 3006, 3015):
        image.nifti_header.set_intent(intent, allow_unknown=True)
        nibabel.save(image, path)
        tool.layout_refused('NIfTI', 'CIFTI-2', path, 'a matrix of CIFTI-2', 'wb_command -cifti-separate')
    for intent, words in ((1008, 'a list of points'), (1009, 'triangles of a surface'), (2005, 'nodes of a surface')):
        tool.refused(write_nifti(tool, 'i.nii', field(4, 1, 3), intent), words)
    tool.equal(write_nifti(tool, 'i.nii', field(4, 1, 3), 2007), field(4, 1, 3)[..., 0, 0].T, warned='coefficients of a deformation')
    says(tool, write_nifti(tool, 'i.nii', field(4, 1, 2), 'label'), name='component 1', meaning='labels')
    for code, unit, words in (('hz', 'Hz', 'a frequency'), ('ppm', 'ppm', 'a chemical shift'), ('rads', 'rad/s', 'an angular frequency')):
        image = nibabel.Nifti1Image(field(4, 7), numpy.eye(4))
        image.header.set_xyzt_units('mm', code)
        nibabel.save(image, tool.path('i.nii'))
        tool.layout('NIfTI', 'fourth axis in Hz, ppm or rad/s', tool.path('i.nii'), field(4, 7)[..., 6].T, step=6, result='steps in this unit, with a warning',
                    time_unit=unit, warned=words)


def check_nrrd_lists(tool):
    """Gradients are a list of volumes, whatever the kind of their axis; an axis without a spacing is none of the volume."""
    volumes = field(5, 3)
    keys = {'modality': 'DWMRI', 'DWMRI_b-value': '1000', 'DWMRI_gradient_0000': '0 0 0', 'DWMRI_gradient_0001': '1 0 0', 'DWMRI_gradient_0002': '0 1 0'}
    matrix, path = numpy.diag([2.0, 2, 3]), tool.path('dwi.nrrd')
    for kinds, is_first in (('vector space space space', True), ('list domain domain domain', True), ('space space space vector', False)):
        rows = numpy.insert(matrix, 0 if is_first else 3, numpy.nan, axis=0)
        header = {'space': 'left-posterior-superior', 'kinds': kinds.split(), 'space directions': rows, 'space origin': [0, 0, 0],
                  'measurement frame': numpy.eye(3), **keys}
        nrrd.write(path, numpy.moveaxis(volumes, 3, 0 if is_first else 3), header)
        tool.layout('NRRD', 'diffusion (DWMRI), kind vector or list', path, volumes[..., 2].T, step=2, result='steps', steps=3, vectors='', spacing=[2, 2, 3])
    for place, spacings in ((0, [numpy.nan, 1, 2, 3]), (3, [1, 2, 3, numpy.nan])):
        nrrd.write(path, numpy.moveaxis(volumes, 3, place), {'spacings': spacings})
        tool.layout('NRRD', 'an axis with spacing NaN, without kinds', path, volumes[..., 1].T, step=1, result='steps, with a warning', spacing=[1, 2, 3],
                    warned=f'axis {place} is (kinds)')
        tool.equal(f'{path}?as=channels&field=component 2', volumes[..., 1].T, warned='')
    nrrd.write(path, volumes[0].transpose(2, 0, 1), {'spacings': [numpy.nan, 1, 2]})
    tool.equal(f'{path}?field=component 3', volumes[0, ..., 2].T[None], spacing=[1, 2, 1])


def write_meta(tool, name, data, channels=1, **more):
    """x, y, z and maybe steps, then the channels."""
    shape = data.shape[:-1] if channels > 1 else data.shape
    kind = {'f4': 'MET_FLOAT', 'u1': 'MET_UCHAR', 'i2': 'MET_SHORT'}[data.dtype.str[1:]]
    fields = {'ObjectType': 'Image', 'NDims': len(shape), 'BinaryData': True, 'DimSize': ' '.join(map(str, shape)), 'ElementNumberOfChannels': channels,
              'ElementType': kind, **more, 'ElementDataFile': 'LOCAL'}
    axes = list(range(len(shape) - 1, -1, -1)) + [len(shape)] * (channels > 1)
    with open(tool.path(name), 'wb') as f:
        f.write(''.join(f'{key} = {value}\n' for key, value in fields.items()).encode())
        f.write(numpy.ascontiguousarray(data.transpose(axes)).tobytes())
    return tool.path(name)


def check_metaimage(tool):
    v = field(5, 3)
    has_vectors(tool, write_meta(tool, 'v.mha', v, 3), v)
    says(tool, tool.path('v.mha'), unit='mm')
    path = write_meta(tool, 'steps.mha', v)
    says(tool, path, steps=3)
    has_vectors(tool, path + '?as=vectors', v, sep='&')
    tool.equal(path + '?as=channels&field=component 3', v[..., 2].T)
    tool.equal(tool.path('v.mha') + '?as=rgb&field=green', v[..., 1].T)
    says(tool, tool.path('v.mha') + '?as=time', steps=3, times=None)  # channels have no interval
    tool.equal(tool.path('v.mha') + '?as=time', v[..., 2].T, step=2)
    says(tool, write_meta(tool, 'rgb.mha', numpy.zeros((*SHAPE, 3), 'u1'), 3), name='red', others=['green', 'blue'])
    tool.refused(write_meta(tool, 'two.mha', field(5, 2), 2) + '?as=rgb', '2 numbers per voxel', 'time, channels or labels')


def check_nrrd(tool):
    v = field(6, 3)
    for first in (True, False):
        data = numpy.moveaxis(v, -1, 0) if first else v
        kinds = ['vector', *['space'] * 3] if first else [*['space'] * 3, 'vector']
        for kind, readings in (('vector', ('', 'vectors')), ('list', ('vectors',)), ('RGB-color', ('vectors',))):
            path = tool.path('v.nrrd')
            nrrd.write(path, data, {'kinds': [kind if k == 'vector' else k for k in kinds]})
            for reading in readings:
                has_vectors(tool, path + (f'?as={reading}' if reading else ''), v, sep='&' if reading else '?')
            says(tool, path + '?as=time', steps=3)
            tool.equal(path + '?as=time', v[..., 1].T, step=1)
            tool.equal(path + '?as=rgb&field=blue', v[..., 2].T)
            tool.equal(path + '?as=channels&field=component 2', v[..., 1].T)
    nrrd.write(tool.path('t.nrrd'), numpy.moveaxis(field(6, 7), -1, 0), {'kinds': ['3D-masked-symmetric-matrix', *['space'] * 3]})
    says(tool, tool.path('t.nrrd'), name='mask', others=['xx', 'xy', 'xz', 'yy', 'yz', 'zz'])
    tool.refused(tool.path('t.nrrd') + '?as=rgb', '7 numbers per voxel', 'time, channels or labels')


def check_slicer(tool):
    """Segmentations and sequences of 3D Slicer, and the four axes of SimpleITK."""
    labels = numpy.random.default_rng(8).integers(0, 3, size=(2, *SHAPE)).astype('u1')
    keys = {'Segment0_Name': 'Liver', 'Segment0_Layer': '0', 'Segment1_Name': 'Tumor', 'Segment1_Layer': '1', 'Segment1_LabelValue': '1'}
    header = {'space': 'left-posterior-superior', 'kinds': ['list', *['domain'] * 3],
              'space directions': numpy.array([[numpy.nan] * 3, [2, 0, 0], [0, 3, 0], [0, 0, 4.0]])}
    path = tool.path('a.seg.nrrd')
    nrrd.write(path, labels, {**header, **keys})
    tool.equal(path, labels[0].T, steps=1, meaning='labels', name='Liver', other0='Tumor', spacing=[2, 3, 4], warned='')
    tool.equal(f'{path}?field=Tumor', labels[1].T, steps=1, meaning='labels', name='Tumor', other0='Liver')
    tool.equal(f'{path}?as=time', labels[1].T, step=1, steps=2)
    nrrd.write(path, labels, {**header, **keys, 'Segment2_Name': 'Vessel', 'Segment2_Layer': '0'})
    tool.equal(path, labels[0].T, meaning='labels', name='Liver, Vessel', other0='Tumor')
    nrrd.write(path, labels, {**header, 'Segmentation_MasterRepresentation': 'Binary labelmap'})
    tool.equal(path, labels[0].T, meaning='labels', name='layer 1', other0='layer 2')
    nrrd.write(path, labels[0], {'Segment0_Name': 'Liver', 'Segment0_Layer': '0'})
    tool.equal(path, labels[0].T, meaning='labels', name='Liver', warned='')
    data = field(9, 5)
    path = tool.path('a.seq.nrrd')
    times = {'axis 0 index type': 'numeric', 'axis 0 index values': '0 1.5 3 6 10'}
    nrrd.write(path, numpy.moveaxis(data, -1, 0), {**header, **times, 'units': ['s', 'mm', 'mm', 'mm']})
    tool.equal(path, data[..., 3].T, step=3, steps=5, times=[0, 1.5, 3, 6, 10], time_unit='s', meaning='', warned='')
    nrrd.write(path, numpy.moveaxis(data, -1, 0), {**header, 'axis 0 index values': '0 3 2 1 5'})
    tool.equal(path, data[..., 3].T, step=3, steps=5, warned='rising numbers')
    image = SimpleITK.GetImageFromArray(data[..., :3].T.copy(), isVector=False)
    image.SetSpacing((2, 3, 4, 5))
    path = tool.path('four.nrrd')
    SimpleITK.WriteImage(image, path)
    tool.equal(f'{path}?as=time', data[..., 2].T, step=2, steps=3, times=[0, 5, 10], spacing=[2, 3, 4])
    tool.equal(f'{path}?as=labels', data[..., 2].T, step=2, steps=3, meaning='labels')
    tool.equal(f'{path}?as=channels&field=component 3', data[..., 2].T, steps=1, spacing=[2, 3, 4])
    has_vectors(tool, f'{path}?as=vectors', data[..., :3], sep='&')


def check_choices(tool):
    """Choices that are unknown, empty, repeated or without effect are errors that name the known ones."""
    path = tool.path('plain.nrrd')
    nrrd.write(path, field(10))
    for query, *words in (('foo=1', '"foo="', 'known are level='), ('as=', '"as=" needs a value'),
                          ('unit=', '"unit=" needs a value'), ('as=time&as=rgb', 'as=time&as=rgb', 'once each'),
                          ('unit=mm&foo=1', '"foo="', 'known are level=')):
        tool.refused(f'{path}?{query}', *words)
    tool.refused(f'{path}?level=2', 'no levels of detail')
    tool.refused(f'{path}?unit=foo bar', 'one word')
    named = tool.path('plain?foo=1.nrrd')
    nrrd.write(named, field(10))
    tool.equal(named, field(10).T)


def check_free_axis(tool, path, data, array=''):
    """The first axis of `data`, which has 3 entries of z, y, x or y, x, as steps, fields and colours; of an array of a file if it has a name."""
    planes = data if data.ndim == 4 else data[:, None]
    suffix = f'&field={array}' if array else ''
    for step in (0, 2):
        tool.equal(f'{path}?as=time{suffix}', planes[step], step=step, steps=3)
    info, samples = tool.dump(f'{path}?as=channels{suffix}')
    tool.checks += 1
    if info and (info['steps'] != 1 or not numpy.array_equal(samples, planes[0])):
        tool.fail(path, f'as=channels gives {info["steps"]} steps and {samples.ravel()[:4]}, expected {planes[0].ravel()[:4]}')
    if info:
        tool.equal(f'{path}?as=channels&field={array + " 3" if array else info["other1"]}', planes[2])
    if array:
        tool.equal(f'{path}?as=rgb&field={array} 2', planes[1], steps=1)
    else:
        tool.equal(f'{path}?as=rgb&field=green', planes[1], name='green', steps=1)
    says(tool, f'{path}?as=labels{suffix}', meaning='labels')
    if path.endswith('.tif'):
        tool.refused(f'{path}?as=vectors', 'as=vectors', '3 numbers per voxel', 'time, rgb, channels or labels')
    else:
        tool.equal(f'{path}?as=vectors&field={f"{array} z".strip()}', planes[2], type='float32', steps=1)


def check_tiff(tool):
    data = numpy.random.default_rng(8).integers(0, 255, (3, 4, 6, 7)).astype('u1')  # free axis, z, y, x
    path = tool.path('as.tif')
    for how in ({'metadata': None}, {}, {'imagej': True}, {'truncate': True}, {'metadata': {'axes': 'TYX'}}, {'metadata': {'axes': 'CYX'}}, {'tile': (16, 16)}):
        tifffile.imwrite(path, data[:, 0], photometric='minisblack', **how)
        check_free_axis(tool, path, data[:, 0])
    tifffile.imwrite(path, data, photometric='minisblack', metadata={'axes': 'CZYX'})
    check_free_axis(tool, path, data)
    tifffile.imwrite(path, data, photometric='minisblack', imagej=True, metadata={'axes': 'TZYX', 'finterval': 2})
    check_free_axis(tool, path, data)
    tool.equal(path + '?as=time', data[1], step=1, times=[0, 2, 4])
    tifffile.imwrite(tool.path('as.ome.tif'), data, photometric='minisblack', metadata={'axes': 'CZYX', 'Channel': {'Name': ['a', 'b', 'c']}})
    check_free_axis(tool, tool.path('as.ome.tif'), data)
    tool.equal(tool.path('as.ome.tif') + '?as=channels&field=b', data[1], name='b')
    film = numpy.random.default_rng(9).integers(0, 255, (5, 6, 7, 3)).astype('u1')
    tifffile.imwrite(path, film, photometric='rgb', metadata=None)
    tool.equal(path + '?as=time&field=green', film[4:5, ..., 1], step=4, steps=5, name='green')
    tool.equal(path + '?as=channels&field=channel 3', film[..., 2], name='channel 3', steps=1)
    tool.equal(path + '?as=rgb&field=blue', film[..., 2], name='blue')
    tifffile.imwrite(path, film, photometric='minisblack', planarconfig='contig', metadata=None)
    tool.equal(path + '?as=rgb&field=blue', film[..., 2], name='blue')
    tifffile.imwrite(path, film[:1], photometric='rgb', metadata=None)
    tool.refused(path + '?as=time', '3 numbers per voxel', 'rgb, channels or labels')
    tifffile.imwrite(path, film[..., 0], photometric='minisblack', metadata=None)
    tool.refused(path + '?as=rgb', '5 numbers per voxel', 'time, channels or labels')
    tifffile.imwrite(path, film[0, ..., 0], photometric='minisblack', metadata=None)
    tool.refused(path + '?as=time', 'one number per voxel', 'labels')
    tifffile.imwrite(path, film[..., :2].transpose(0, 3, 1, 2), photometric='minisblack', metadata={'axes': 'TCYX'})
    tool.equal(path + '?as=channels&field=channel 2', film[3:4, ..., 1], step=3, steps=5)
    tool.refused(path + '?as=time', '2 numbers per voxel', 'channels or labels')


def check_arrays(tool):
    """Zarr, HDF5 and NetCDF: the free axis has the channels, or time, or z."""
    data = numpy.random.default_rng(8).integers(0, 255, (3, 4, 6, 7)).astype('u1')
    for zarr_format in (2, 3):
        path = tool.path(f'as{zarr_format}.zarr')
        for values in (data, data[:, 0]):
            zarr.create_array(path, data=values, chunks=values.shape, zarr_format=zarr_format, overwrite=True)
            check_free_axis(tool, path, values)
        zarr.create_array(path, data=data, chunks=data.shape, zarr_format=3, overwrite=True, dimension_names=('t', 'z', 'y', 'x'))
        check_free_axis(tool, path, data)
    with h5py.File(tool.path('as.h5'), 'w') as file:
        file['four'], file['three'] = data, data[:, 0]
    for name, values in (('four', data), ('three', data[:, 0])):
        check_free_axis(tool, tool.path('as.h5'), values, f'/{name}')
    with netCDF4.Dataset(tool.path('as.nc'), 'w') as file:
        for name, size in zip(('time', 'part', 'z', 'y', 'x'), (3, *data.shape)):
            file.createDimension(name, size)
        for name, axes in (('fields', 'part z y x'), ('steps', 'time z y x'), ('planes', 'part y x')):
            file.createVariable(name, 'u1', axes.split())[:] = data[:, 0] if name == 'planes' else data
    for name in ('fields', 'steps', 'planes'):
        check_free_axis(tool, tool.path('as.nc'), data[:, 0] if name == 'planes' else data, name)


def check_hounsfield(tool):
    """The unit is HU only for CT, never for an overview, and for a derived image only if the file says HU."""
    for unit, modality, kind, rescale in (('HU', 'CT', 'ORIGINAL\\PRIMARY\\AXIAL', ''), ('HU', 'CT', 'ORIGINAL\\PRIMARY\\AXIAL', 'HU'),
                                          ('', 'CT', 'ORIGINAL\\PRIMARY\\LOCALIZER', 'HU'), ('', 'CT', 'ORIGINAL\\PRIMARY\\LOCALIZER', ''),
                                          ('', 'CT', 'DERIVED\\SECONDARY\\OTHER', ''), ('HU', 'CT', 'DERIVED\\SECONDARY\\REFORMATTED', 'HU'),
                                          ('', 'CT', 'ORIGINAL\\PRIMARY\\AXIAL', 'US'), ('MGML', 'CT', 'ORIGINAL\\PRIMARY\\AXIAL', 'MGML'),
                                          ('', 'MR', 'ORIGINAL\\PRIMARY', 'HU'), ('', 'MR', 'ORIGINAL\\PRIMARY', '')):
        path = dicom_files.enhanced(tool.path('hu.dcm'), dicom_files.stack(3), modality=modality)
        data = pydicom.dcmread(path)
        data.ImageType = kind.split('\\')
        shared = data.SharedFunctionalGroupsSequence[0]
        values = dicom_files.item(RescaleSlope=1, RescaleIntercept=-1024)
        if rescale:
            values.RescaleType = rescale
        shared.PixelValueTransformationSequence = [values]
        data.save_as(path)
        says(tool, path, value_unit=unit)
        del shared.PixelValueTransformationSequence  # numbers of the scanner
        data.save_as(path)
        says(tool, path, value_unit='')


def check_missing(tool):
    for mark in (-9999, 1e20):
        data = field(7) * 10
        data[:2] = mark
        path = write_nifti(tool, 'm.nii', data)
        tool.equal(path, data.T)  # they stay samples


def check(tool):
    for part in (check_nifti_vectors, check_nifti_scaled_vectors, check_nifti_intents, check_nifti_others, check_nrrd_lists, check_metaimage, check_nrrd, check_slicer, check_choices, check_tiff, check_arrays, check_hounsfield, check_missing):
        part(tool)
