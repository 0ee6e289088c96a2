# SPDX-License-Identifier: Apache-2.0
"""Writes DICOM files with several frames. Each function returns the path that it was given."""
import numpy
from pydicom import dcmread
from pydicom.dataset import Dataset, FileDataset, FileMetaDataset
from pydicom.sequence import Sequence
from pydicom.uid import (DeflatedExplicitVRLittleEndian, ExplicitVRBigEndian, ExplicitVRLittleEndian, ImplicitVRLittleEndian, RLELossless,
                         generate_uid)

SYNTAXES = [ExplicitVRLittleEndian, ImplicitVRLittleEndian, ExplicitVRBigEndian, RLELossless, DeflatedExplicitVRLittleEndian]
CLASSES = {'CT': '1.2.840.10008.5.1.4.1.1.2.1', 'MR': '1.2.840.10008.5.1.4.1.1.4.1', 'NM': '1.2.840.10008.5.1.4.1.1.20',
           'OT': '1.2.840.10008.5.1.4.1.1.7.3', 'RTDOSE': '1.2.840.10008.5.1.4.1.1.481.2', 'SEG': '1.2.840.10008.5.1.4.1.1.66.4',
           'MAP': '1.2.840.10008.5.1.4.1.1.30', 'US': '1.2.840.10008.5.1.4.1.1.3.1', 'XA': '1.2.840.10008.5.1.4.1.1.12.1'}
PACKED = SYNTAXES[3:]
AXIAL = ((1, 0, 0), (0, 1, 0))


def item(**members):
    """A data set with these members; lists of data sets become sequences."""
    result = Dataset()
    for name, value in members.items():
        is_items = isinstance(value, list) and value and isinstance(value[0], Dataset)
        setattr(result, name, Sequence(value) if is_items else value)
    return result


class Frame:
    """Pixels (rows, columns) with their place; the world has values · slope + intercept."""

    def __init__(self, values, position=(0, 0, 0), along=AXIAL, spacing=(0.7, 0.5, 2.0), slope=1, intercept=0, stack='1'):
        self.values, self.position, self.along, self.spacing = values, position, along, spacing
        self.slope, self.intercept, self.stack, self.groups = slope, intercept, stack, {}

    def place(self):
        return {'position': self.position, 'along': self.along, 'spacing': self.spacing}

    def scaled(self, slope, intercept):
        return Frame(self.values.astype(float), slope=slope, intercept=intercept, **self.place())


def stack(count, first=(5, 6, 0), along=AXIAL, step=(0, 0, 2), slopes=None, dtype='u2', stack_id='1'):
    """Frames one step apart from each other, with different values everywhere."""
    spacing = (0.7, 0.5, float(numpy.linalg.norm(step)))
    return [Frame(numpy.arange(80 * z, 80 * (z + 1), dtype=dtype).reshape(8, 10), numpy.array(first, float) + z * numpy.array(step, float), along,
                  spacing, slopes[z] if slopes else 1, stack=stack_id) for z in range(count)]


def begin(modality, shape, syntax=ExplicitVRLittleEndian, allocated=16, sop_class=None):
    """A data set for frames of this shape (frames, rows, columns)."""
    meta = FileMetaDataset()
    meta.MediaStorageSOPClassUID = CLASSES[sop_class or modality]
    meta.MediaStorageSOPInstanceUID = generate_uid()
    meta.TransferSyntaxUID = syntax
    data = FileDataset('', {}, file_meta=meta, preamble=bytes(128), is_implicit_VR=syntax == ImplicitVRLittleEndian,
                       is_little_endian=syntax != ExplicitVRBigEndian)
    data.SOPClassUID, data.SOPInstanceUID = meta.MediaStorageSOPClassUID, meta.MediaStorageSOPInstanceUID
    data.Modality, data.SeriesInstanceUID, data.StudyInstanceUID = modality, generate_uid(), generate_uid()
    data.InstanceNumber = 1
    data.NumberOfFrames, data.Rows, data.Columns = (int(n) for n in shape)
    data.SamplesPerPixel, data.PhotometricInterpretation = 1, 'MONOCHROME2'
    data.BitsAllocated = data.BitsStored = allocated
    data.HighBit, data.PixelRepresentation = allocated - 1, 0
    return data


def save(data, path, pixels, element='PixelData'):
    """Writes numbers in the byte order of the data set, or compresses them."""
    syntax = data.file_meta.TransferSyntaxUID
    is_rle = syntax == RLELossless
    dtype = numpy.dtype(pixels.dtype).newbyteorder('>' if syntax == ExplicitVRBigEndian else '<')
    raw = numpy.ascontiguousarray(pixels, dtype).tobytes()
    setattr(data, element, raw + bytes(len(raw) % 2))
    if element == 'PixelData':
        data['PixelData'].VR = 'OB' if data.BitsAllocated <= 8 else 'OW'
    if is_rle:
        data.file_meta.TransferSyntaxUID = ExplicitVRLittleEndian
        data.compress(RLELossless, generate_instance_uid=False)
    data.save_as(path, enforce_file_format=True)
    return path


def changed(path, **members):
    data = dcmread(path)
    for name, value in members.items():
        setattr(data, name, value)
    data.save_as(path)
    return path


def groups_of(frame):
    content = frame.groups.get('FrameContentSequence') or Dataset()
    content.StackID = frame.stack
    own = {**frame.groups, 'FrameContentSequence': content}
    own['PlanePositionSequence'] = item(ImagePositionPatient=[float(n) for n in frame.position])
    own['PlaneOrientationSequence'] = item(ImageOrientationPatient=[float(f'{n:.12g}') for n in numpy.ravel(frame.along)])
    return item(**{name: [value] for name, value in own.items()})


def add_groups(data, frames):
    shared = frames[0].spacing
    data.SharedFunctionalGroupsSequence = Sequence([item(PixelMeasuresSequence=[item(PixelSpacing=[shared[1], shared[0]], SliceThickness=shared[2])])])
    data.PerFrameFunctionalGroupsSequence = Sequence([groups_of(frame) for frame in frames])


def enhanced(path, frames, modality='CT', syntax=ExplicitVRLittleEndian, scaled='frame'):
    pixels = numpy.stack([f.values for f in frames])
    data = begin(modality, pixels.shape, syntax)
    add_groups(data, frames)
    if scaled == 'shared':
        data.SharedFunctionalGroupsSequence[0].PixelValueTransformationSequence = Sequence(
            [item(RescaleSlope=2, RescaleIntercept=-100, RescaleType='US')])
    elif any(f.slope != 1 for f in frames):
        for group, frame in zip(data.PerFrameFunctionalGroupsSequence, frames):
            group.PixelValueTransformationSequence = Sequence([item(RescaleSlope=frame.slope, RescaleIntercept=0, RescaleType='HU')])
    return save(data, path, pixels.astype('u2'))


def nuclear(path, frames, between=None, slot_ms=None, phases_ms=None, **vectors):
    pixels = numpy.stack([f.values for f in frames])
    data = begin('NM', pixels.shape)
    data.PixelSpacing, data.SliceThickness = [0.5, 0.7], 2
    if between:
        data.SpacingBetweenSlices = between
    data.FrameIncrementPointer = [{'SliceVector': 0x00540080, 'TimeSlotVector': 0x00540070, 'EnergyWindowVector': 0x00540010, 'PhaseVector': 0x00540030,
                                   'TimeSliceVector': 0x00540100, 'RotationVector': 0x00540050, 'AngularViewVector': 0x00540090}[name] for name in vectors]
    if not vectors:
        del data.FrameIncrementPointer
    for name, numbers in vectors.items():
        setattr(data, name, numbers)
    if slot_ms:
        slots = [item(TimeSlotTime=slot_ms) for _ in range(2)]
        data.GatedInformationSequence = Sequence([item(DataInformationSequence=[item(FrameTime=slot_ms, TimeSlotInformationSequence=slots)])])
    if phases_ms:
        data.PhaseInformationSequence = Sequence([item(ActualFrameDuration=ms, NumberOfFramesInPhase=2, PhaseDelay=0) for ms in phases_ms])
    place = frames[0]
    data.DetectorInformationSequence = Sequence([item(ImagePositionPatient=[float(n) for n in place.position],
                                                      ImageOrientationPatient=[float(n) for n in numpy.ravel(place.along)])])
    return save(data, path, pixels)


def capture(path, frames, **members):
    pixels = numpy.stack([f.values for f in frames])
    data = begin('OT', pixels.shape)
    for name, value in members.items():
        setattr(data, name, value)
    return save(data, path, pixels)


def dose(path, frames, offsets):
    pixels = numpy.stack([f.values for f in frames]).astype('u4')
    data = begin('RTDOSE', pixels.shape, allocated=32)
    data.PixelSpacing, data.SliceThickness = [0.5, 0.7], ''
    data.ImagePositionPatient, data.ImageOrientationPatient = [1, 2, 3], [1, 0, 0, 0, 1, 0]
    data.GridFrameOffsetVector, data.FrameIncrementPointer = list(offsets), 0x3004000c
    data.DoseGridScaling, data.DoseUnits, data.DoseType = 0.001, 'GY', 'PHYSICAL'
    return save(data, path, pixels)


def segmentation(path, listed, names, most=None):
    """`listed` has (number of the segment, frame); with `most` the pixels are shares of it."""
    pixels = numpy.stack([f.values for _, f in listed]).astype('u1')
    data = begin('SEG', pixels.shape, allocated=8 if most else 1)
    data.SegmentationType = 'FRACTIONAL' if most else 'BINARY'
    if most:
        data.MaximumFractionalValue, data.SegmentationFractionalType = most, 'OCCUPANCY'
    data.SegmentSequence = Sequence([item(SegmentNumber=n, SegmentLabel=name) for n, name in names.items()])
    for number, frame in listed:
        frame.groups['SegmentIdentificationSequence'] = item(ReferencedSegmentNumber=number)
    add_groups(data, [frame for _, frame in listed])
    return save(data, path, pixels if most else numpy.packbits(pixels.ravel(), bitorder='little'))


def parametric(path, frames, dtype, slope, intercept, syntax=ExplicitVRLittleEndian):
    pixels = numpy.stack([f.values for f in frames]).astype(dtype)
    data = begin('MR', pixels.shape, syntax, 8 * pixels.dtype.itemsize, 'MAP')
    add_groups(data, frames)
    unit = item(CodeValue='mm2/s', CodingSchemeDesignator='UCUM', CodeMeaning='mm2/s')
    mapping = item(RealWorldValueSlope=slope, RealWorldValueIntercept=intercept, MeasurementUnitsCodeSequence=[unit], LUTLabel='ADC')
    data.SharedFunctionalGroupsSequence[0].RealWorldValueMappingSequence = Sequence([mapping])
    if dtype != 'u2':
        del data.BitsStored, data.HighBit, data.PixelRepresentation
    return save(data, path, pixels, {'f4': 'FloatPixelData', 'f8': 'DoubleFloatPixelData', 'u2': 'PixelData'}[dtype])


def with_table(path, frames, table):
    """Real-world values that only a lookup table gives."""
    parametric(path, frames, 'u2', 1, 0)
    data = dcmread(path)
    mapping = data.SharedFunctionalGroupsSequence[0].RealWorldValueMappingSequence[0]
    del mapping.RealWorldValueSlope, mapping.RealWorldValueIntercept
    for name, value in (('RealWorldValueFirstValueMapped', 0), ('RealWorldValueLastValueMapped', len(table) - 1)):
        setattr(mapping, name, value)
        mapping[name].VR = 'US'
    mapping.RealWorldValueLUTData = list(table)
    data.save_as(path)
    return path


def typed(path, values, allocated, stored, high, signed, syntax):
    """Bits that are not used are noise, as overlays are."""
    data = begin('OT', values.shape, syntax, allocated)
    data.BitsStored, data.HighBit, data.PixelRepresentation = stored, high, signed
    if allocated == 1:
        if syntax in PACKED:
            data.file_meta.TransferSyntaxUID = ExplicitVRLittleEndian
        return save(data, path, numpy.packbits(values.astype('u1').ravel(), bitorder='little'))
    dtype = {8: 'u1', 16: 'u2', 32: 'u4'}[allocated]
    mask, shift = 2 ** stored - 1, high + 1 - stored
    noise = numpy.random.default_rng(4).integers(0, 2 ** allocated, values.shape) & ~(mask << shift)
    return save(data, path, ((values & mask) << shift | noise).astype(dtype))


def colored(path, colors, interpretation, planar):
    data = begin('US', colors.shape[:3], allocated=8)
    data.SamplesPerPixel, data.PhotometricInterpretation, data.PlanarConfiguration = 3, interpretation, planar
    data.FrameTime, data.FrameIncrementPointer = 33.3, 0x00181063
    return save(data, path, colors.transpose(0, 3, 1, 2) if planar else colors)


def halved(path, colors):
    """Luminance of each pixel, differences of each pair."""
    data = begin('US', colors.shape[:3], allocated=8)
    data.SamplesPerPixel, data.PhotometricInterpretation, data.PlanarConfiguration = 3, 'YBR_FULL_422', 0
    pairs = numpy.stack([colors[:, :, ::2, 0], colors[:, :, 1::2, 0], colors[:, :, ::2, 1], colors[:, :, ::2, 2]], axis=-1)
    return save(data, path, pairs)


def palette(path, indices, table, first):
    data = begin('US', indices.shape, allocated=8 * indices.dtype.itemsize)
    data.PhotometricInterpretation = 'PALETTE COLOR'
    for channel, name in enumerate(('Red', 'Green', 'Blue')):
        setattr(data, f'{name}PaletteColorLookupTableDescriptor', [len(table), first, 16])
        setattr(data, f'{name}PaletteColorLookupTableData', table[:, channel].astype('<u2').tobytes())
    return save(data, path, indices)
