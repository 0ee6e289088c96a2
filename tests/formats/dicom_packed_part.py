# SPDX-License-Identifier: Apache-2.0
"""Packed pixels whose header and code disagree, fragments without offsets, and ways of packing that are refused."""
import io

import numpy
import PIL.Image
import pydicom
from pydicom.encaps import encapsulate, encapsulate_extended
from pydicom.uid import JPEG2000Lossless, JPEGBaseline8Bit, JPEGLSLossless, RLELossless

import dicom_files as files
from dicom_folder_part import warned

ROWS, COLUMNS = numpy.mgrid[0:32, 0:48]
COLORS = numpy.stack([ROWS * 7, COLUMNS * 5, (ROWS + COLUMNS) * 3], -1).astype('u1')  # smooth: JPEG keeps them within 3


def packed(path, codes, syntax, shape=COLORS.shape, offsets=True, fragments=1, **tags):
    """A film whose frames have these codes."""
    data = files.begin('US', (len(codes), *shape[:2]), syntax, 8 if len(shape) == 3 else 16)
    data.SamplesPerPixel = shape[2] if len(shape) == 3 else 1
    if len(shape) == 3:
        data.PhotometricInterpretation, data.PlanarConfiguration = 'RGB', 0
    data.FrameTime, data.FrameIncrementPointer = 33.3, 0x00181063
    for name, value in tags.items():
        setattr(data, name, value)
    if offsets == 'extended':
        data.PixelData, data.ExtendedOffsetTable, data.ExtendedOffsetTableLengths = encapsulate_extended(codes)
    else:
        data.PixelData = encapsulate(codes, has_bot=offsets, fragments_per_frame=fragments)
    data['PixelData'].VR, data['PixelData'].is_undefined_length = 'OB', True
    data.save_as(path, enforce_file_format=True)
    return path


def code_of(array, form, **options):
    bits = io.BytesIO()
    PIL.Image.fromarray(array).save(bits, form, **options)
    return bits.getvalue()


def check_channels(tool, path, expected, within=0, step=0):
    """One channel is enough: colours that are taken for others, or mixed up, change all of them."""
    info, samples = tool.dump(f'{path}?field=blue', step)
    tool.checks += 1
    if info and numpy.abs(samples[0].astype(int) - expected[..., 2]).max() > within:
        tool.fail(path, f'blue differs by {numpy.abs(samples[0].astype(int) - expected[..., 2]).max()}')


def without_marks(code):
    """A JPEG without the marks of JFIF and Adobe."""
    at, kept = 2, code[:2]
    while code[at + 1] != 0xda:
        size = 2 + int.from_bytes(code[at + 2:at + 4], 'big')
        kept += b'' if 0xe0 <= code[at + 1] <= 0xef else code[at:at + size]
        at += size
    return kept + code[at:]


def with_adobe(code, transform):
    return code[:2] + b'\xff\xee\x00\x0eAdobe\x00\x64\0\0\0\0' + bytes([transform]) + code[2:]


def check_colors(tool):
    """The compressed code says what its colours are; if it does not, the header says it."""
    ybr = code_of(COLORS, 'JPEG', quality=98, subsampling=0)
    rgb = code_of(COLORS, 'JPEG', quality=98, subsampling=0, keep_rgb=True)
    for name, code, tag, is_told in (('jfif', ybr, 'RGB', True), ('jfif', ybr, 'YBR_FULL_422', False), ('names', rgb, 'YBR_FULL', True),
                                     ('names', rgb, 'RGB', False), ('bare', without_marks(ybr), 'YBR_FULL', False),
                                     ('adobe', with_adobe(without_marks(ybr), 1), 'RGB', True)):
        path = packed(tool.path(f'{name} {tag}.dcm'), [code], JPEGBaseline8Bit, PhotometricInterpretation=tag)
        check_channels(tool, path, COLORS, within=4)
        if is_told:
            warned(tool, path, f'The header calls the colours {tag}', 'as the code says')
        elif name != 'adobe':  # pydicom looks at JFIF and the names of the components
            check_channels(tool, path, pydicom.dcmread(path).pixel_array, within=4)
    for mct, tag in ((1, 'YBR_RCT'), (1, 'RGB'), (0, 'RGB')):
        code = code_of(COLORS, 'JPEG2000', irreversible=False, no_jp2=True, mct=mct)
        check_channels(tool, packed(tool.path(f'j2k {mct} {tag}.dcm'), [code], JPEG2000Lossless, PhotometricInterpretation=tag), COLORS)
    code = code_of(COLORS, 'JPEG2000', irreversible=False, no_jp2=True, mct=1)
    path = packed(tool.path('twice.dcm'), [code], JPEG2000Lossless, PhotometricInterpretation='YBR_FULL')
    check_channels(tool, path, pydicom.dcmread(path).pixel_array, within=1)
    warned(tool, path, 'may be wrong', 'YBR_FULL', 'JPEG 2000')


def check_planar(tool):
    """PlanarConfiguration has no meaning for packed pixels."""
    frames = [COLORS, COLORS[::-1].copy()]
    for number in (1, 2):
        path = packed(tool.path('planar.dcm'), [code_of(one, 'JPEG', quality=98, subsampling=0) for one in frames[:number]], JPEGBaseline8Bit,
                      PhotometricInterpretation='YBR_FULL_422', PlanarConfiguration=1)
        check_channels(tool, path, frames[number - 1], within=4, step=number - 1)
        path = packed(tool.path('planar.dcm'), [code_of(one, 'JPEG2000', irreversible=False, no_jp2=True, mct=1) for one in frames[:number]],
                      JPEG2000Lossless, PhotometricInterpretation='YBR_RCT', PlanarConfiguration=1)
        check_channels(tool, path, frames[number - 1], step=number - 1)
    for syntax in (RLELossless, JPEGLSLossless):
        data = pydicom.dcmread(files.colored(tool.path('plain.dcm'), numpy.stack(frames), 'RGB', 0))
        data.compress(syntax)
        data.PlanarConfiguration = 1
        path = tool.path(f'planar {syntax.name}.dcm')
        data.save_as(path, enforce_file_format=True)
        check_channels(tool, path, frames[1], step=1)
    data = pydicom.dcmread(files.colored(tool.path('plain.dcm'), numpy.stack(frames), 'RGB', 1))
    data.file_meta.TransferSyntaxUID = files.DeflatedExplicitVRLittleEndian
    path = tool.path('planar deflated.dcm')
    data.save_as(path, enforce_file_format=True)
    check_channels(tool, path, frames[1], step=1)


def check_fragments(tool):
    """Several fragments per frame: with offsets of 4 or 8 bytes, or with none."""
    frames = [numpy.random.default_rng(n).integers(0, 4096, (32, 48)).astype('u2') for n in range(3)]
    codes = [code_of(one, 'JPEG2000', irreversible=False, no_jp2=True) for one in frames]
    for number, (offsets, fragments) in enumerate(((True, 3), (False, 3), (False, 1), (True, 1), ('extended', 1))):
        path = packed(tool.path(f'fragments{number}.dcm'), codes, JPEG2000Lossless, (32, 48), offsets, fragments)
        for step, one in enumerate(frames):
            tool.equal(path, one[None], step=step, steps=3)


def check_refused(tool):
    """Ways of packing and of colours that are not read: their name and a remedy, for a file and for a folder."""
    path = packed(tool.path('unknown.dcm'), [code_of(COLORS, 'JPEG')], JPEGBaseline8Bit)
    with open(path, 'rb') as file:
        start = file.read()
    before = JPEGBaseline8Bit.encode()
    for uid, *words in (('1.2.840.10008.1.2.4.201', 'HTJ2K', 'pydicom'), ('1.2.840.10008.1.2.4.110', 'JPEG XL', 'without compression'),
                        ('1.2.840.10008.1.2.4.100.1', 'MPEG-2', 'ffmpeg'), ('1.2.840.10008.1.2.4.102', 'MPEG-4', 'ffmpeg'),
                        ('1.2.840.10008.1.2.4.92', 'JPEG 2000 part 2'), ('1.2.3.4.5', 'the transfer syntax 1.2.3.4.5 is not known')):
        after = uid.encode() + b'\0' * (len(uid) % 2)
        with open(path, 'wb') as file:
            size = len(before) + len(before) % 2
            at = start.index(before)
            file.write(start[:at - 2] + len(after).to_bytes(2, 'little') + after + start[at + size:])
        tool.refused(path, *words)
    for kind in ('HSV', 'CMYK', 'ARGB', 'YBR_PARTIAL_422', 'YBR_PARTIAL_420'):
        path = files.changed(files.colored(tool.path(f'{kind}.dcm'), COLORS[None], 'RGB', 0), PhotometricInterpretation=kind)
        tool.layout_refused('DICOM', kind, path, f'colours of the kind {kind}', 'PhotometricInterpretation', 'supported are RGB')


def check(tool):
    for part in (check_colors, check_planar, check_fragments, check_refused):
        part(tool)
