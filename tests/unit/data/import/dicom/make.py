#!/usr/bin/env python3
# SPDX-License-Identifier: Apache-2.0
"""Writes the files of this folder again; needs pydicom, numpy and gdcmconv. Sample i of slice k is (7 i + 100 k) % 4096 - 1024 * is_signed."""
import subprocess

import numpy as np
import pydicom
from pydicom.dataset import FileDataset, FileMetaDataset
from pydicom.uid import CTImageStorage, ExplicitVRBigEndian, ExplicitVRLittleEndian, ImplicitVRLittleEndian, generate_uid

COLUMNS, ROWS = 16, 12  # large enough for the blocks of JPEG
SERIES = '1.2.826.0.1.3680043.8.498.1'


def pixels(k, is_signed):
    values = (7 * np.arange(COLUMNS * ROWS) + 100 * k) % 4096 - 1024 * is_signed
    return values.reshape(ROWS, COLUMNS).astype(np.int16 if is_signed else np.uint16)


def image(k, is_signed, series=SERIES):
    meta = FileMetaDataset()
    meta.MediaStorageSOPClassUID = CTImageStorage
    meta.MediaStorageSOPInstanceUID = generate_uid(entropy_srcs=[series, str(k)])
    meta.TransferSyntaxUID = ExplicitVRLittleEndian
    d = FileDataset('', {}, file_meta=meta, preamble=b'\0' * 128)
    d.SOPClassUID, d.SOPInstanceUID = CTImageStorage, meta.MediaStorageSOPInstanceUID
    d.SeriesInstanceUID, d.StudyInstanceUID, d.Modality = series, series + '.0', 'CT'
    d.InstanceNumber = 10 - k  # against the order of places
    d.ImageOrientationPatient = [1, 0, 0, 0, 0, -1]  # coronal: rows to the left, columns down
    d.ImagePositionPatient = [-10, 5 + 2.5 * k, 30]
    d.PixelSpacing, d.SliceThickness = [0.75, 0.5], 2
    d.Rows, d.Columns, d.SamplesPerPixel, d.PhotometricInterpretation = ROWS, COLUMNS, 1, 'MONOCHROME2'
    d.BitsAllocated, d.BitsStored, d.HighBit, d.PixelRepresentation = 16, 16 if is_signed else 12, 15 if is_signed else 11, is_signed
    d.RescaleSlope, d.RescaleIntercept = 1, -24
    d.PixelData = pixels(k, is_signed).tobytes()
    return d


def save(d, name, syntax=ExplicitVRLittleEndian):
    d.file_meta.TransferSyntaxUID = syntax
    pydicom.dcmwrite(name, d, implicit_vr=syntax.is_implicit_VR, little_endian=syntax.is_little_endian, force_encoding=True)


def items(**members):
    """A sequence of one item."""
    item = pydicom.Dataset()
    for name, value in members.items():
        setattr(item, name, value)
    return pydicom.Sequence([item])


def group(position, **groups):
    return items(PlanePositionSequence=items(ImagePositionPatient=position), **groups)[0]


def enhanced():
    """Frame n of time t and place k has the samples of slice k + 3 t, the slope k + 1 and the delay 250 t ms."""
    d = image(0, 0, SERIES + '.12')
    for name in ('ImagePositionPatient', 'ImageOrientationPatient', 'PixelSpacing', 'SliceThickness', 'RescaleSlope', 'RescaleIntercept'):
        delattr(d, name)
    order = [(1, 2), (0, 1), (1, 0), (0, 2), (0, 0), (1, 1)]
    d.NumberOfFrames = len(order)
    d.SharedFunctionalGroupsSequence = items(PlaneOrientationSequence=items(ImageOrientationPatient=[1, 0, 0, 0, 0, -1]),
                                             PixelMeasuresSequence=items(PixelSpacing=[0.75, 0.5], SliceThickness=2))
    d.PerFrameFunctionalGroupsSequence = pydicom.Sequence([group(
        [-10, 5 + 2.5 * k, 30], PixelValueTransformationSequence=items(RescaleSlope=k + 1, RescaleIntercept=0, RescaleType='US'),
        CardiacSynchronizationSequence=items(NominalCardiacTriggerDelayTime=250.0 * t)) for t, k in order])
    d.PixelData = b''.join(pixels(k + 3 * t, 0).tobytes() for t, k in order)
    return d


def segments():
    """Segment 1 in the first frame, 2 in the last; bit i of plane k is set if i is a multiple of k + 2. The plane between is left out."""
    d = image(0, 0, SERIES + '.13')
    for name in ('ImagePositionPatient', 'ImageOrientationPatient', 'PixelSpacing', 'SliceThickness', 'RescaleSlope', 'RescaleIntercept'):
        delattr(d, name)
    d.Rows, d.Columns, d.NumberOfFrames, d.Modality, d.SegmentationType = 3, 5, 2, 'SEG', 'BINARY'
    d.BitsAllocated, d.BitsStored, d.HighBit = 1, 1, 0
    d.SegmentSequence = pydicom.Sequence([items(SegmentNumber=n, SegmentLabel=name)[0] for n, name in ((1, 'left'), (2, 'right'))])
    d.SharedFunctionalGroupsSequence = items(PlaneOrientationSequence=items(ImageOrientationPatient=[1, 0, 0, 0, 1, 0]),
                                             PixelMeasuresSequence=items(PixelSpacing=[0.75, 0.5], SliceThickness=2, SpacingBetweenSlices=2))
    d.PerFrameFunctionalGroupsSequence = pydicom.Sequence([group(
        [0, 0, 2 * k], SegmentIdentificationSequence=items(ReferencedSegmentNumber=n)) for n, k in ((1, 0), (2, 2))])
    bits = [i % (k + 2) == 0 for k in (0, 2) for i in range(15)]
    d.PixelData = np.packbits(bits, bitorder='little').tobytes()
    return d


def main():
    for k in range(4):
        save(image(k, 0), f'series{k}.dcm')
    other = image(0, 0, SERIES + '.5')
    other.RescaleType = 'US'  # not HU
    save(other, 'unspecified.dcm')
    other = image(1, 0)  # an overview of the same series
    other.ImageOrientationPatient = [0, 1, 0, 0, 0, -1]
    save(other, 'overview.dcm')
    for n, syntax in enumerate(('jpeg', 'jpegls', 'j2k', 'rle')):
        save(image(0, 0, f'{SERIES}.{n + 1}'), '/tmp/one.dcm')
        subprocess.run(['gdcmconv', '--' + syntax, '/tmp/one.dcm', syntax + '.dcm'], check=True)
    save(image(0, 1, SERIES + '.7'), 'implicit.dcm', ImplicitVRLittleEndian)
    big = image(0, 1, SERIES + '.8')
    big.PixelData = pixels(0, 1).byteswap().tobytes()
    save(big, 'big.dcm', ExplicitVRBigEndian)
    bare = pydicom.Dataset()  # without preamble and group 2
    bare.update(image(0, 1, SERIES + '.9'))
    pydicom.dcmwrite('bare.dcm', bare, implicit_vr=True, little_endian=True)
    frames = image(0, 1, SERIES + '.10')
    frames.NumberOfFrames = 3
    frames.PixelData = b''.join(pixels(k, 1).tobytes() for k in range(3))
    save(frames, 'frames.dcm')
    colors = image(0, 0, SERIES + '.11')
    del colors.RescaleSlope, colors.RescaleIntercept
    colors.SamplesPerPixel, colors.PhotometricInterpretation, colors.PlanarConfiguration = 3, 'RGB', 1
    colors.BitsAllocated, colors.BitsStored, colors.HighBit = 8, 8, 7
    colors.PixelData = bytes(i % 251 for i in range(3 * ROWS * COLUMNS))
    save(colors, 'colors.dcm')
    save(enhanced(), 'enhanced.dcm')
    save(segments(), 'segments.dcm')


main()
