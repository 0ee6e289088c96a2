# SPDX-License-Identifier: Apache-2.0
"""Segmentations, parametric maps and enhanced images that highdicom writes, against the volumes that highdicom reads from them; compressed
pixels and files of real devices, against pydicom."""
import io
import os
import shutil
import warnings

import highdicom
import numpy
import PIL.Image
import pydicom
from highdicom.content import AlgorithmIdentificationSequence
from highdicom.sr.coding import CodedConcept
from pydicom.encaps import encapsulate
from pydicom.pixels import pixel_array
from pydicom.sr.codedict import codes
from pydicom.uid import ExplicitVRLittleEndian, JPEG2000Lossless, JPEGBaseline8Bit, JPEGLSLossless, RLELossless, generate_uid

from dicom_folder_part import CORONAL, Series, pixels

DEVICE = {'manufacturer': 'splatd', 'manufacturer_model_name': 'tests', 'software_versions': '1', 'device_serial_number': '1'}
PATIENT = {'PatientID': '1', 'PatientName': 'a^b', 'PatientBirthDate': '', 'PatientSex': '', 'StudyID': '', 'StudyDate': '', 'StudyTime': '',
           'AccessionNumber': '', 'ReferringPhysicianName': '', 'FrameOfReferenceUID': '1.2.3', 'PositionReferenceIndicator': '', 'Modality': 'CT',
           'SeriesDescription': 'x', 'Manufacturer': '', 'ImageType': ['ORIGINAL', 'PRIMARY', 'AXIAL'], 'RescaleSlope': 2, 'RescaleIntercept': -100,
           'Laterality': '', 'PatientPosition': 'HFS', 'KVP': 100, 'AcquisitionNumber': 1, 'AcquisitionDate': '20200101', 'AcquisitionTime': '101010',
           'ContentDate': '20200101', 'ContentTime': '101010'}


def sources(tool, name, orientation, count=5):
    """A series for which highdicom writes objects."""
    series = Series(tool, name, **PATIENT)
    step = numpy.cross(orientation[:3], orientation[3:]) * 2
    for z in range(count):
        series.add(f'{z}.dcm', z, ImageOrientationPatient=list(orientation), ImagePositionPatient=[float(n) for n in numpy.array([5, 6, 7]) + z * step])
    return [pydicom.dcmread(series.path(f'{z}.dcm')) for z in range(count)]


def described(number, label):
    return highdicom.seg.SegmentDescription(
        number, label, codes.SCT.Tissue, codes.SCT.Tissue, 'AUTOMATIC',
        AlgorithmIdentificationSequence('a', CodedConcept('1', '99TEST', 'a'), '1'))


def segmentation(path, images, mask, kind, syntax=ExplicitVRLittleEndian):
    names = ('left', 'right')
    highdicom.seg.Segmentation(images, mask, kind, [described(n + 1, name) for n, name in enumerate(names)], generate_uid(), 1, generate_uid(), 1,
                               transfer_syntax_uid=syntax, **DEVICE).save_as(path)
    return path


def equal_volume(tool, source, volume, array=None, **wanted):
    """Fails unless the volume equals highdicom's, from either end of the slices."""
    info, samples = tool.dump(source)
    tool.checks += 1
    if info is None:
        return
    affine, data = volume.affine, volume.array if array is None else array
    own = numpy.eye(4)
    own[:3, :3] = (numpy.reshape(info['direction'], (3, 3)) * info['spacing'])[:, ::-1]  # of z, y, x
    own[:3, 3] = info['origin']
    if numpy.dot(own[:3, 0], affine[:3, 0]) < 0:
        affine, data = affine.copy(), data[::-1]
        affine[:3, 3] += affine[:3, 0] * (len(data) - 1)
        affine[:3, 0] *= -1
    if samples.shape != data.shape or not numpy.allclose(samples, data):
        tool.fail(source, f'the samples differ from those of highdicom: {samples.shape}, {data.shape}')
    if not numpy.allclose(own, affine, atol=1e-5):
        tool.fail(source, f'affine {own.tolist()}, highdicom has {affine.tolist()}')
    for key, value in wanted.items():
        if info.get(key) != value:
            tool.fail(source, f'{key} is {info.get(key)}, expected {value}')


def check_segmentations(tool):
    rng = numpy.random.default_rng(8)
    for orientation, kind, syntax in (((1, 0, 0, 0, 1, 0), 'BINARY', ExplicitVRLittleEndian), (CORONAL, 'BINARY', ExplicitVRLittleEndian),
                                      (CORONAL, 'LABELMAP', ExplicitVRLittleEndian), ((0, 1, 0, 0, 0, -1), 'LABELMAP', RLELossless),
                                      (CORONAL, 'FRACTIONAL', RLELossless)):
        images = sources(tool, f'highdicom-{kind}-{orientation}', orientation)
        mask = rng.integers(0, 3, (5, 8, 10)).astype('u1')
        mask[2] = 0  # frames that are left out
        if kind == 'FRACTIONAL':
            mask = rng.random((5, 8, 10, 2)).astype('f4')
        path = segmentation(tool.path(f'highdicom {kind}.dcm'), images, mask, kind, syntax)
        read = highdicom.seg.segread(path)
        if kind == 'FRACTIONAL':
            volume = read.get_volume(rescale_fractional=True)
            for n, name in enumerate(('left', 'right')):
                equal_volume(tool, f'{path}?field={name}', volume, volume.array[..., n], name=name)
            continue
        volume = read.get_volume(combine_segments=True)
        equal_volume(tool, path, volume, name='labels')


def check_maps(tool):
    rng = numpy.random.default_rng(9)
    images = sources(tool, 'highdicom-map', CORONAL)
    for dtype in ('f4', 'f8', 'u2'):
        values = (rng.random((5, 8, 10)) * 1000).astype(dtype)
        if dtype == 'u2':
            mapping = highdicom.pm.RealWorldValueMapping('a', 'b', codes.UCUM.SquareMillimeterPerSecond, (0, 1000), slope=0.5, intercept=10)
        else:
            mapping = highdicom.pm.RealWorldValueMapping('a', 'b', codes.UCUM.SquareMillimeterPerSecond, (0.0, 1000.0), slope=1, intercept=0)
        one = highdicom.pm.ParametricMap(images, values, generate_uid(), 1, generate_uid(), 1, contains_recognizable_visual_features=False,
                                         real_world_value_mappings=[mapping], voi_lut_transformations=[highdicom.VOILUTTransformation(window_center=1, window_width=1)], **DEVICE)
        path = tool.path(f'highdicom map {dtype}.dcm')
        one.save_as(path)
        volume = highdicom.imread(path).get_volume(apply_real_world_transform=dtype == 'u2', dtype='f8')
        equal_volume(tool, path, volume, value_unit='mm2/s')


def check_legacy(tool):
    """A series of single slices as one file with frames."""
    for orientation in ((1, 0, 0, 0, 1, 0), CORONAL):
        images = sources(tool, f'highdicom-legacy-{orientation}', orientation)
        one = highdicom.legacy.LegacyConvertedEnhancedCTImage(images, generate_uid(), 1, generate_uid(), 1)
        path = tool.path('highdicom legacy.dcm')
        one.save_as(path)
        equal_volume(tool, path, highdicom.imread(path).get_volume(dtype='f8'), value_unit='HU')


def check_packed(tool):
    """JPEG-LS and JPEG 2000 without loss, signed and not, and JPEG in colours, against pydicom."""
    def save(series, z, one, bits):
        if bits:
            one.PixelData, one.file_meta.TransferSyntaxUID = encapsulate([bits.getvalue()]), JPEG2000Lossless
            one['PixelData'].VR = 'OB'
        else:
            one.compress(JPEGLSLossless)
        one.save_as(series.path(f'{z}.dcm'), enforce_file_format=True)

    for name, signed in (('unsigned', 0), ('signed', 1)):
        series = Series(tool, f'packed-{name}')
        values = [numpy.tile(pixels(z), (6, 6)).astype('i4') - 300 * signed for z in range(4)]
        for z, one in enumerate(values):
            bits = io.BytesIO() if z % 2 and not signed else None
            if bits:
                PIL.Image.fromarray(one.astype('u2')).save(bits, 'JPEG2000', irreversible=False, no_jp2=True)
            data = series.dataset(one, z, PixelRepresentation=signed, PixelData=one.astype('<i2' if signed else '<u2').tobytes())
            save(series, z, data, bits)
        tool.equal(series.folder, values)
    wide = numpy.random.default_rng(5).integers(0, 65536, (8, 10, 3), 'u2')  # GDCM mixes up the bytes of RLE
    for name, syntax in (('rle', RLELossless), ('jpegls', JPEGLSLossless)):
        series = Series(tool, f'packed-wide-{name}')
        data = series.dataset(wide[..., 0], 0, SamplesPerPixel=3, PhotometricInterpretation='RGB', PlanarConfiguration=0, PixelData=wide.tobytes())
        data.compress(syntax)
        data.save_as(series.path('0.dcm'), enforce_file_format=True)
        for channel, field in enumerate(('red', 'green', 'blue')):
            tool.equal(f'{series.path("0.dcm")}?field={field}', wide[None, ..., channel])
    colors = numpy.random.default_rng(4).integers(0, 256, (2, 4, 4, 3), 'u1').repeat(16, 1).repeat(16, 2)
    series = Series(tool, 'packed-colors')
    for z, one in enumerate(colors):
        bits = io.BytesIO()
        PIL.Image.fromarray(one).save(bits, 'JPEG', quality=95, subsampling=0)
        data = series.dataset(one[..., 0], z, SamplesPerPixel=3, PhotometricInterpretation='YBR_FULL_422', PlanarConfiguration=0, BitsAllocated=8,
                              BitsStored=8, HighBit=7, PixelData=encapsulate([bits.getvalue()]))
        data.file_meta.TransferSyntaxUID = JPEGBaseline8Bit
        data['PixelData'].VR = 'OB'
        data.save_as(series.path(f'{z}.dcm'), enforce_file_format=True)
    unpacked = numpy.stack([pydicom.dcmread(series.path(f'{z}.dcm')).pixel_array for z in range(2)])
    for channel, name in enumerate(('red', 'green', 'blue')):
        tool.equal(f'{series.folder}?field={name}', unpacked[..., channel])


SAMPLES = ['693_J2KI', 'ExplVR_BigEnd', 'JPEG2000', 'JPEGLSNearLossless_16', 'J2K_pixelrep_mismatch', 'MR_small_padded', 'SC_jpeg_no_color_transform',
           'SC_rgb_dcmtk_+eb+cy+s4', 'SC_rgb_jls_lossy_line', 'SC_rgb_jpeg_app14_dcmd', 'SC_rgb_rle_16bit', 'SC_rgb_rle_32bit_2frame',
           'SC_rgb_small_odd_big_endian', 'SC_ybr_full_422_uncompressed', 'image_dfl', 'liver_1frame', 'rtdose_rle', 'examples_overlay']


def check_samples(tool):
    """Files of real devices and programs that pydicom brings, the first channel of the first step."""
    folder = os.path.join(os.path.dirname(pydicom.__file__), 'data', 'test_files')
    for name in SAMPLES:
        path = tool.path(f'sample {name}.dcm')
        shutil.copy(os.path.join(folder, f'{name}.dcm'), path)
        data = pydicom.dcmread(path)
        expected = pixel_array(data)
        expected = expected[..., 0] if data.SamplesPerPixel == 3 else expected
        expected = expected if expected.ndim == 3 else expected[None]
        scale = float(data.get('DoseGridScaling') or data.get('RescaleSlope') or 1)
        info, samples = tool.dump(path + '?as=slice' if len(expected) == 1 else path)
        tool.checks += 1
        if info and not numpy.allclose(samples, expected * scale + float(data.get('RescaleIntercept') or 0), rtol=1e-6, atol=1e-6):
            tool.fail(path, f'the samples differ from those of pydicom: {samples.ravel()[:6]}, {expected.ravel()[:6]}')


def check(tool):
    warnings.filterwarnings('ignore', '.*excess padding')
    for part in (check_segmentations, check_maps, check_legacy, check_packed, check_samples):
        part(tool)
