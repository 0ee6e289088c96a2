# SPDX-License-Identifier: Apache-2.0
"""NIfTI against nibabel, DICOM against pydicom."""
import glob
import os

import nibabel
import numpy
import pydicom
from pydicom.uid import RLELossless

from ramp import ramp


def check_affine(tool, source, affine, anatomy, step=0):
    """Fails unless each index has the same place in the world as in the independent reader."""
    info, _ = tool.dump(source, step)
    tool.checks += 1
    if info is None:
        return
    direction = numpy.reshape(info['direction'], (3, 3))
    got = numpy.eye(4)
    got[:3, :3] = direction * info['spacing']
    got[:3, 3] = info['origin']
    if not numpy.allclose(got, affine, rtol=1e-5, atol=1e-4):
        tool.fail(source, f'the grid is\n{got}\nexpected\n{affine}')
    if info['anatomy'] != anatomy:
        tool.fail(source, f'the axes are {info["anatomy"]}, expected {anatomy}')


def check_image(tool, path, step=0):
    image = nibabel.load(path)
    data = numpy.asanyarray(image.dataobj)
    tool.equal(path, (data[..., step] if data.ndim == 4 else data).T, step=step)
    check_affine(tool, path, image.affine, 'RAS', step)


def check_nifti(tool):
    turned = numpy.array([[0, -2, 0, 10], [1.5, 0, 0.2, -20], [0, 0.1, 3, 30], [0, 0, 0, 1]])
    for kind, ending in ((nibabel.Nifti1Image, 'nii'), (nibabel.Nifti1Image, 'nii.gz'), (nibabel.Nifti2Image, 'nii'), (nibabel.Nifti1Pair, 'hdr')):
        for dtype in ('u1', '<i2', '>f4', '<u4'):
            image = kind(ramp((4, 5, 6), dtype), turned)
            image.set_data_dtype(dtype)
            image.to_filename(tool.path(f'a.{ending}'))
            check_image(tool, tool.path(f'a.{ending}'))
    image = nibabel.Nifti1Image(ramp((4, 5, 6), 'i2'), None)
    image.header.set_slope_inter(0.5, -3)
    image.header.set_qform(numpy.diag([2, 3, 4, 1]), 'scanner')
    image.to_filename(tool.path('scaled.nii'))
    check_image(tool, tool.path('scaled.nii'))
    nibabel.Nifti1Image(ramp((4, 5, 6, 3), 'i2'), turned).to_filename(tool.path('time.nii'))
    check_image(tool, tool.path('time.nii'), step=2)
    sample = tool.sample('nifti', 'mni_icbm152_t1_2009a.nii.gz')
    if sample:
        check_image(tool, sample)


def volume_of(files):
    """(samples as z, y, x, affine in LPS) of the slices of a series."""
    slices = [pydicom.dcmread(name) for name in files]
    along = [numpy.array(slices[0].ImageOrientationPatient[i:i + 3], float) for i in (0, 3)]
    normal = numpy.cross(*along)
    slices.sort(key=lambda s: numpy.dot(normal, numpy.array(s.ImagePositionPatient, float)))
    samples = numpy.stack([s.pixel_array * float(getattr(s, 'RescaleSlope', 1)) + float(getattr(s, 'RescaleIntercept', 0)) for s in slices])
    first, last = (numpy.array(s.ImagePositionPatient, float) for s in (slices[0], slices[-1]))
    affine = numpy.eye(4)
    affine[:3, 0] = along[0] * float(slices[0].PixelSpacing[1])
    affine[:3, 1] = along[1] * float(slices[0].PixelSpacing[0])
    affine[:3, 2] = (last - first) / (len(slices) - 1)
    affine[:3, 3] = first
    return samples, affine


def check_dicom(tool):
    sample = tool.sample('dicom', 'CTHeadAxialDicom')
    if not sample:
        return
    files = sorted(glob.glob(os.path.join(sample, '*.dcm')))
    samples, affine = volume_of(files)
    tool.equal(sample, samples)
    check_affine(tool, sample, affine, 'LPS')
    folder = tool.path('packed')
    os.makedirs(folder)
    for i, name in enumerate(files[40:44]):
        one = pydicom.dcmread(name)
        one.compress(RLELossless)
        one.save_as(os.path.join(folder, f'{9 - i}.dcm'))
    samples, affine = volume_of(glob.glob(os.path.join(folder, '*.dcm')))
    tool.equal(os.path.join(folder, '9.dcm'), samples, unit='mm')
    check_affine(tool, os.path.join(folder, '8.dcm'), affine, 'LPS')


def check_metaimage(tool):
    sample = tool.sample('metaimage', 'HeadMRVolume.mhd')
    if sample:
        with open(sample, encoding='ascii') as file:
            keys = dict(line.strip().split(' = ', 1) for line in file if ' = ' in line)
        dims = [int(n) for n in keys['DimSize'].split()]
        data = numpy.fromfile(sample.replace('.mhd', '.raw'), 'u1').reshape(dims[::-1])
        tool.equal(sample, data, spacing=[float(n) for n in keys['ElementSpacing'].split()])


def check(tool):
    check_nifti(tool)
    check_dicom(tool)
    check_metaimage(tool)
