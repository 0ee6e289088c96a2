# SPDX-License-Identifier: Apache-2.0
"""Series that are more than slices of one type at one time: mosaics, several files with frames, reconstructions of one scan, times across midnight."""
import os
import struct
import warnings

import numpy
import pydicom
from pydicom.uid import ExplicitVRBigEndian, RLELossless

import dicom_files as files
from dicom_folder_part import Series, pixels, silent, stack, volume, warned, whole

CLOCKS = {  # tags of step t: the first is before midnight
    'bare': lambda t: {'AcquisitionTime': ('235958.5', '000001.5', '000004.5')[t]},
    'content': lambda t: {'AcquisitionTime': ('235958.5', '000001.5', '000004.5')[t], 'ContentDate': '20200102', 'ContentTime': f'0010{t:02}'},
    'dated': lambda t: {'AcquisitionTime': ('235958.5', '000001.5', '000004.5')[t], 'AcquisitionDate': ('20191231', '20200101', '20200101')[t]},
    'whole': lambda t: {'AcquisitionDateTime': ('20191231235958.5-0500', '20200101000001.5-0500', '20200101000004.5-0500')[t]},
    'old': lambda t: {'AcquisitionTime': ('23:59:58.5', '00:00:01.5', '00:00:04.5')[t], 'AcquisitionDate': ('2019.12.31', '2020.01.01', '2020.01.01')[t]},
}


def check_midnight(tool):
    for name, tags in CLOCKS.items():
        series = Series(tool, f'midnight-{name}')
        for z in range(3):
            for t in range(3):
                series.add(f'{t}{z}.dcm', z, t, InstanceNumber=None, **tags(t))
        whole(tool, series.folder, count=3, time=1, step=1, times=[0.0, 3.0, 6.0])
    day = Series(tool, 'midday')  # no gap of half a day: nothing passes midnight
    for z in range(3):
        for t, hour in enumerate(('01', '09', '20')):
            day.add(f'{t}{z}.dcm', z, t, InstanceNumber=None, AcquisitionTime=f'{hour}0000')
    whole(tool, day.folder, count=3, step=2, time=2, times=[0.0, 28800.0, 68400.0])


def check_scout(tool):
    """An overview beside the folders of a study does not hide them."""
    study = tool.path('scouted')
    scout = Series(tool, 'scouted-scout', study, SeriesNumber=1, SeriesDescription='Scout')
    scout.add('scout.dcm', 0)
    for name, count, time in (('thin', 6, 1), ('thick', 3, 2)):
        series = Series(tool, f'scouted-{name}', os.path.join(study, name), SeriesNumber=count, SeriesDescription=name)
        for z in range(count):
            series.add(f'{z}.dcm', z, time)
    whole(tool, study, time=1)
    warned(tool, study, 'largest of 3', '"Scout" (1 image)', '"thick" (3 images)')
    whole(tool, f'{study}?series=Scout', count=1)
    whole(tool, os.path.join(study, 'scout.dcm'), count=1)


def check_missing(tool):
    """Warnings name the places and distances that a file lacks, and the values that are used instead."""
    frames = files.stack(4)
    values = numpy.stack([f.values for f in frames])
    for modality in ('CT', 'MR'):
        path = files.enhanced(tool.path('bare.dcm'), frames, modality)
        path = files.changed(path, SharedFunctionalGroupsSequence=[], PerFrameFunctionalGroupsSequence=[])
        tool.equal(path, values, spacing=[1, 1, 1], unit='')
        warned(tool, path, 'where its images lie', 'how far apart its pixels are', 'how far apart its slices are')
        path = files.changed(path, PixelSpacing=[0.5, 0.7])
        tool.equal(path, values, spacing=[0.7, 0.5, 1], unit='mm')
        warned(tool, path, 'where its images lie', 'shown 1 mm apart')
    path = files.capture(tool.path('apart.dcm'), frames, PixelSpacing=[0.5, 0.7])
    warned(tool, path, 'how far apart its slices are')
    path = files.capture(tool.path('known.dcm'), frames, PixelSpacing=[0.5, 0.7], SpacingBetweenSlices=2)
    warned(tool, path, 'where its images lie')
    silent(tool, files.enhanced(tool.path('good.dcm'), frames))
    alone = stack(tool, 'alone', count=1, ImagePositionPatient=None)
    warned(tool, alone.folder, 'where its images lie')


def check_gaps(tool):
    """Positions without directions are axial; without positions the locations of the slices count."""
    axial = Series(tool, 'gap-directions')
    for z in range(4):
        axial.add(f'{z}.dcm', z, ImageOrientationPatient=None, InstanceNumber=9 - z)
    whole(tool, axial.folder, count=4, anatomy='LPS')
    warned(tool, axial.folder, 'shown as axial')
    located = Series(tool, 'gap-position')
    for z in range(4):
        located.add(f'{z}.dcm', z, ImagePositionPatient=None, SliceLocation=3 * z - 5, InstanceNumber=9 - z)
    tool.equal(located.folder, [pixels(z) for z in range(4)], spacing=[0.7, 0.5, 3], origin=[0, 0, -5])
    warned(tool, located.folder, 'SliceLocation', 'not known')
    ratio = stack(tool, 'ratio', PixelSpacing=None, PixelAspectRatio=[3, 2])
    whole(tool, ratio.folder, spacing=[1, 1.5, 2], unit='')
    warned(tool, ratio.folder, 'how far apart its pixels')
    knees = Series(tool, 'knees')
    for z in range(3):
        for n in range(2):
            knees.add(f'{n}{z}.dcm', z, n, ImagePositionPatient=[5 + 100 * n, 6, 2 * z])
    warned(tool, knees.folder, 'up to 100 mm beside each other')
    flat = stack(tool, 'flat', RescaleSlope=0, RescaleIntercept=-5)
    tool.equal(flat.folder, [pixels(z).astype('i4') - 5 for z in range(6)])
    warned(tool, flat.folder, 'slope is 0')
    inverse = stack(tool, 'inverse', PhotometricInterpretation='MONOCHROME1')
    whole(tool, inverse.folder)
    warned(tool, inverse.folder, 'MONOCHROME1')


def check_twins(tool):
    """Copies with ids of their own: the pixels tell."""
    series = stack(tool, 'twins')
    for z in range(6):
        series.add(f'copy{z}.dcm', z, InstanceNumber=z + 1)
    whole(tool, series.folder)
    warned(tool, series.folder, 'Left out 6 copies', 'copy0.dcm (of 00.dcm)')
    whole(tool, series.path('copy3.dcm'))
    series.add('other.dcm', 3, samples=pixels(3) + 7, InstanceNumber=4)
    tool.refused(series.folder, 'show the same place')


def check_bare(tool):
    """Files of implicit types without a preamble or an extension."""
    series = Series(tool, 'bare')
    for z in range(4):
        one = pydicom.Dataset(series.dataset(pixels(z), z))
        one['PixelData'].VR = 'OW'
        pydicom.dcmwrite(series.path(f'{z}'), one, implicit_vr=True, little_endian=True, enforce_file_format=False)
    whole(tool, series.folder, count=4)
    whole(tool, series.path('1'), count=4)


def check_words(tool):
    """Bytes in words of the other byte order, frames of an odd size."""
    values = (numpy.arange(3 * 63) % 251).astype('u1').reshape(3, 7, 9)
    one = files.begin('OT', values.shape, ExplicitVRBigEndian, 8)
    raw = numpy.append(values.ravel(), 0).astype('u1')
    one.PixelData = raw.reshape(-1, 2)[:, ::-1].tobytes()
    one['PixelData'].VR = 'OW'
    path = tool.path('words.dcm')
    pydicom.dcmwrite(path, one, enforce_file_format=True)
    tool.equal(path, pydicom.dcmread(path).pixel_array)
    tool.equal(path, values)


def csa_header(version=2, **members):
    """A CSA header as nibabel describes it: each element has six items, of which the first ones are used."""
    out = [b'SV10\4\3\2\1' if version == 2 else b'', struct.pack('<2I', len(members) + 1, 77)]
    for name, values in {'AcquisitionMatrixText': '6*4', **members}.items():
        values = values if isinstance(values, list) else [values]
        out.append(struct.pack('<64si4s3i', name.encode(), len(values), {str: b'SH', int: b'IS'}.get(type(values[0]), b'FD'), 3, 6, 77))
        for n in range(6):
            text = (values[n] if isinstance(values[n], str) else f'{values[n]:.8g}').encode() + b'\0' if n < len(values) else b''
            out.append(struct.pack('<4i', len(text) + (6 if version == 1 else 0), len(text), 77, len(text)) + text + bytes(-len(text) % 4))
    return b''.join(out)


class Mosaic(Series):
    """Mosaics of Siemens: the slices of one time are tiles of one image."""

    def tiles(self, name, slices, csa=None, along=None, **tags):
        count, rows, columns = slices.shape
        side = int(numpy.ceil(numpy.sqrt(count)))
        image = numpy.zeros((side * rows, side * columns), 'u2')
        for n, one in enumerate(slices):
            image[n // side * rows:(n // side + 1) * rows, n % side * columns:(n % side + 1) * columns] = one
        along = numpy.eye(3)[:2] if along is None else along
        one = self.dataset(image, 0, ImageType=['ORIGINAL', 'PRIMARY', 'M', 'ND', 'MOSAIC'], Manufacturer='SIEMENS', SpacingBetweenSlices=2.5,
                           ImageOrientationPatient=[f'{n:.9f}' for n in numpy.ravel(along)], **tags)
        if csa:
            one.private_block(0x29, 'SIEMENS CSA HEADER', create=True).add_new(0x10, 'OB', csa)
        one.save_as(self.path(name), enforce_file_format=True)
        return self.path(name)


def check_mosaics(tool):
    """Against nibabel: values and affine, also of slices against the normal, of an oblique volume, of many times."""
    warnings.filterwarnings('ignore', '.*DICOM readers are highly experimental')
    from nibabel.nicom.dicomwrappers import wrapper_from_file
    rng = numpy.random.default_rng(6)
    turn = numpy.linalg.qr(numpy.array([[1, 0.2, 0.1], [-0.3, 1, 0.2], [0.1, -0.1, 1]]))[0].T
    for name, count, along, sign in (('plain', 7, numpy.eye(3), 1), ('against', 5, numpy.eye(3), -1), ('oblique', 9, turn, 1), ('oblique2', 4, turn, -1)):
        series = Mosaic(tool, f'mosaic-{name}')
        slices = rng.integers(0, 4096, (count, 6, 4))
        normal = sign * numpy.cross(along[0], along[1])
        path = series.tiles('a.dcm', slices, csa_header(EchoLinePosition=1, NumberOfImagesInMosaic=count, SliceNormalVector=list(normal)), along[:2])
        reference = wrapper_from_file(path)
        info, samples = tool.dump(path)
        tool.checks += 1
        affine = numpy.array(reference.affine)
        data = reference.get_data().transpose(2, 0, 1)
        is_turned = info and numpy.dot(numpy.reshape(info['direction'], (3, 3))[:, 2], affine[:3, 2]) < 0
        if is_turned:  # the same volume from its other end
            affine[:3, 3] += affine[:3, 2] * (count - 1)
            affine[:3, 2] *= -1
            data = data[::-1]
        if info and (samples.shape != data.shape or not numpy.array_equal(samples, data)):
            tool.fail(path, f'the samples differ from those of nibabel: {samples.shape}, {data.shape}')
        own = numpy.reshape(info['direction'], (3, 3)) * info['spacing'] if info else 0
        # nibabel's first axis goes down the columns
        if info and not (numpy.allclose(own[:, [1, 0, 2]], affine[:3, :3], atol=1e-5) and numpy.allclose(info['origin'], affine[:3, 3], atol=1e-5)):
            tool.fail(path, f'affine {own}, {info["origin"]}, nibabel has {affine}')
    times = Mosaic(tool, 'mosaic-times')
    slices = rng.integers(0, 4096, (3, 5, 6, 4))
    csa = csa_header(NumberOfImagesInMosaic=5, SliceNormalVector=[0, 0, 1])
    for t in range(3):
        times.tiles(f'{t}.dcm', slices[t], csa, AcquisitionTime=f'10101{2 * t}', AcquisitionNumber=t + 1)
    for t in range(3):
        tool.equal(times.folder, slices[t], step=t, steps=3, times=[0.0, 2.0, 4.0], spacing=[0.7, 0.5, 2.5])
    tool.equal(times.path('1.dcm'), slices[2], step=2, steps=3)
    tool.equal(times.path('1.dcm') + '?as=slice', slices[1], steps=1)
    old = Mosaic(tool, 'mosaic-old')
    tool.equal(old.tiles('a.dcm', slices[0], csa_header(1, NumberOfImagesInMosaic=5, SliceNormalVector=[0, 0, -1])), slices[0],
               direction=[1, 0, 0, 0, 1, 0, 0, 0, -1])
    directions = Mosaic(tool, 'mosaic-directions')  # too many for fields: steps in the order of their b-values and of the files
    for t in range(20):
        one = pydicom.dcmread(directions.tiles(f'{t:02}.dcm', slices[0] + t, csa))
        block = one.private_block(0x19, 'SIEMENS MR HEADER', create=True)
        block.add_new(0x0c, 'IS', '1000' if t else '0')
        if t:
            block.add_new(0x0e, 'FD', [float(numpy.cos(t)), float(numpy.sin(t)), 0.0])
        one.save_as(directions.path(f'{t:02}.dcm'))
    for t in (0, 1, 19):
        tool.equal(directions.folder, slices[0] + t, step=t, steps=20)
    header = Mosaic(tool, 'mosaic-header')  # no CSA header
    path = header.tiles('a.dcm', slices[0])
    tool.refused(path, 'mosaic', 'dcm2niix')
    tool.refused(header.folder, 'mosaic', 'dcm2niix')
    one = pydicom.dcmread(path)
    one.private_block(0x19, 'SIEMENS MR HEADER', create=True).add_new(0x0a, 'US', 5)
    one.save_as(path)
    tool.equal(path, slices[0])
    warned(tool, path, 'SliceNormalVector')
    one = pydicom.dcmread(path)
    del one[0x00190010]  # made anonymous
    one.save_as(path)
    tool.equal(path, slices[0])


def check_joined(tool):
    """Files with frames of one series: one per time, one per part of the volume; files that make no stack are named."""
    frames = files.stack(6)
    for name in ('times', 'parts', 'doses'):
        os.makedirs(tool.path(f'joined-{name}'))
    uid = {'SeriesInstanceUID': '1.2.3.4'}
    for t in range(3):
        later = [files.Frame(f.values + 1000 * t, **f.place()) for f in frames]
        files.changed(files.enhanced(tool.path(f'joined-times/{2 - t}.dcm'), later), AcquisitionDateTime=f'2020010110{t}000', InstanceNumber=t + 1, **uid)
    for t in range(3):
        values = [f.values + 1000 * t for f in frames]
        tool.equal(tool.path('joined-times'), values, step=t, steps=3, times=[0.0, 600.0, 1200.0], spacing=[0.7, 0.5, 2])
        tool.equal(tool.path('joined-times/1.dcm'), values, step=t, steps=3)
    for n, part in enumerate((frames[3:], frames[:3])):
        files.changed(files.enhanced(tool.path(f'joined-parts/{n}.dcm'), part), **uid)
    tool.equal(tool.path('joined-parts'), [f.values for f in frames], spacing=[0.7, 0.5, 2])
    silent(tool, tool.path('joined-parts'))
    for n in range(2):  # the same pixels with another scale are no copies
        files.changed(files.dose(tool.path(f'joined-doses/{n}.dcm'), frames, [2.0 * z for z in range(6)]), DoseGridScaling=n + 1, **uid)
    warned(tool, tool.path('joined-doses'), 'Left out 6 other images', '1.dcm')


def check_bits(tool):
    """Slices of one series with different types of pixels, and different scales."""
    kinds = (('u1', 8, 0), ('u2', 12, 0), ('i2', 16, 1), ('u2', 16, 0), ('u4', 32, 0))
    for name, used, kind in (('bytes', kinds[:2], 'uint16'), ('signs', kinds[1:3], 'int16'), ('all', kinds[:4], 'int32'), ('wide', kinds, 'float64')):
        series = Series(tool, f'bits-{name}')
        expected = []
        for z in range(8):
            dtype, stored, signed = used[z % len(used)]
            low = -2 ** (stored - 1) if signed else 0
            values = (pixels(z).astype('i8') * 3571) % 2 ** stored + low
            values[0, :2] = low, low + 2 ** stored - 1
            expected.append(values)
            allocated = 8 * numpy.dtype(dtype).itemsize
            series.add(f'{z}.dcm', z, samples=values, BitsAllocated=allocated, BitsStored=stored, HighBit=stored - 1, PixelRepresentation=signed,
                       PixelData=values.astype('<' + dtype).tobytes())
        tool.equal(series.folder, expected, type=kind)
        silent(tool, series.folder)
        for z in range(8):
            one = pydicom.dcmread(series.path(f'{z}.dcm'))
            one.RescaleSlope, one.RescaleIntercept = 0.5 + z, -z
            one.save_as(series.path(f'{z}.dcm'))
        scaled = [values * (0.5 + z) - z for z, values in enumerate(expected)]
        tool.equal(series.folder, scaled, type='float64' if name == 'wide' else 'float32')


def check_named(tool):
    """A file that was asked for by its name is shown, or the error is about it."""
    series = Series(tool, 'named')
    for z in range(6):
        one = series.dataset(pixels(z), z)
        one.compress(RLELossless)
        one.save_as(series.path(f'{z}.dcm'), enforce_file_format=True)
        if z != 3:
            with open(series.path(f'{z}.dcm'), 'r+b') as file:
                file.seek(-100, os.SEEK_END)
                file.write(b'\x81' * 80)
    whole_slice = [pixels(3) if z == 3 else numpy.full_like(pixels(3), pixels(3).min()) for z in range(6)]
    tool.equal(series.path('3.dcm'), whole_slice)
    warned(tool, series.path('3.dcm'), '5 slices are damaged')
    tool.refused(series.path('1.dcm'), '1.dcm', 'unpacked')
    tool.refused(series.path('5.dcm'), '5.dcm', 'unpacked')


RECONSTRUCTIONS = {  # the tags of two images of one place, the names of the fields
    'kernel': (lambda n: {'ConvolutionKernel': ('B30f', 'B70f')[n]}, ('kernel B30f', 'kernel B70f')),
    'filter': (lambda n: {'FilterType': ('A', 'B')[n]}, ('filter A', 'filter B')),
    'phase': (lambda n: {'ImageType': ['ORIGINAL', 'PRIMARY', ('M', 'PHASE')[n]]}, ('M', 'PHASE')),
    'derived': (lambda n: {'ImageType': [('DERIVED', 'ORIGINAL')[n], 'PRIMARY', 'AXIAL']}, ('DERIVED PRIMARY', 'ORIGINAL PRIMARY')),
    'contrast': (lambda n: {'ContrastBolusAgent': ('Iodine', '')[n]}, ('contrast Iodine', 'no contrast')),
    'echo': (lambda n: {'EchoNumbers': n + 1}, ('echo 1', 'echo 2')),
    'energy': (lambda n: {'KVP': (80, 140)[n]}, ('80 kV', '140 kV')),
    'flip': (lambda n: {'FlipAngle': (3, 15)[n]}, ('flip angle 3°', 'flip angle 15°')),
    'inversion': (lambda n: {'InversionTime': (100, 800)[n]}, ('inversion 100 ms', 'inversion 800 ms')),
    'thickness': (lambda n: {'SliceThickness': (1, 2)[n]}, ('1 mm thick', '2 mm thick')),
    'units': (lambda n: {'Modality': 'PT', 'Units': ('BQML', 'GML')[n]}, ('Bq/ml', 'g/ml')),
    'corrections': (lambda n: {'CorrectedImage': (['ATTN', 'DECY'], ['DECY'])[n]}, ('corrected ATTN DECY', 'corrected DECY')),
    'coil': (lambda n: {'ReceiveCoilName': ('H1', 'H2')[n]}, ('coil H1', 'coil H2')),
    'description': (lambda n: {'DerivationDescription': ('ADC', 'trace')[n]}, ('ADC', 'trace')),
}


def check_reconstructions(tool):
    """Two kinds of images at each place are fields, also if each kind has times of its own."""
    for name, (tags, names) in RECONSTRUCTIONS.items():
        series = Series(tool, f'kinds-{name}')
        for z in range(3):
            for n in range(2):
                series.add(f'{n}{z}.dcm', z, n, AcquisitionTime=f'1010{10 + 20 * n + z}', AcquisitionNumber=n + 1, **tags(n))
        whole(tool, f'{series.folder}?field={names[0]}', count=3, time=0, name=names[0], steps=1)
        whole(tool, series.path('11.dcm'), count=3, time=1, name=names[1], steps=1)
        warned(tool, series.folder, names[0], names[1], '?field=')
    for number, private in enumerate(((0x19, 'SIEMENS MR HEADER', 0x0c, 'IS', '1000'), (0x43, 'GEMS_PARM_01', 0x39, 'IS', ['1000001000', '8']),
                                      (0x2001, 'Philips Imaging DD 001', 0x03, 'FL', 1000.0))):
        series = Series(tool, f'kinds-b-{number}')
        for z in range(3):
            for n in range(2):
                one = series.dataset(pixels(z, n), z)
                group, creator, element, vr, value = private
                value = value if n else 0.0 if vr == 'FL' else '0'
                one.private_block(group, creator, create=True).add_new(element, vr, value)
                one.save_as(series.path(f'{n}{z}.dcm'), enforce_file_format=True)
        whole(tool, f'{series.folder}?field=b 1000 s/mm²', count=3, time=1, name='b 1000 s/mm²')
    shifted = Series(tool, 'kinds-shifted')  # two reconstructions without a place in common
    for z in range(4):
        shifted.add(f'a{z}.dcm', z, ConvolutionKernel='soft')
        shifted.add(f'b{z}.dcm', z, 1, ConvolutionKernel='bone', ImagePositionPatient=[5, 6, 2 * z + 0.5])
    whole(tool, f'{shifted.folder}?field=kernel soft', count=4, steps=1)
    whole(tool, f'{shifted.folder}?field=kernel bone', count=4, time=1, origin=[5, 6, 0.5])
    fewer = Series(tool, 'kinds-fewer')  # the larger kind is shown
    for z in range(5):
        fewer.add(f'a{z}.dcm', z, ConvolutionKernel='soft')
    for z in range(2):
        fewer.add(f'b{z}.dcm', z, 1, ConvolutionKernel='bone')
    whole(tool, fewer.folder, count=5, name='kernel soft')
    phases = Series(tool, 'kinds-phases')
    for z in range(3):
        for t in range(3):
            phases.add(f'{t}{z}.dcm', z, t, NominalPercentageOfCardiacPhase=30.0 * t, InstanceNumber=10 * (t + 1) % 7)
    whole(tool, phases.folder, count=3, time=1, step=1, steps=3, times=[0, 30, 60], time_unit='%')
    structures = phases.dataset(pixels(0), 0, Modality='RTSTRUCT', Rows=None, Columns=None, PixelData=None)
    structures.save_as(tool.path('structures.dcm'), enforce_file_format=True)
    tool.refused(tool.path('structures.dcm'), 'no image', 'modality RTSTRUCT', 'open the series')
    parts = Series(tool, 'kinds-parts')  # one kernel for each half of the places: one volume
    for z in range(6):
        parts.add(f'{z}.dcm', z, ConvolutionKernel='soft' if z < 3 else 'bone')
    whole(tool, parts.folder)
    rounded = Series(tool, 'kinds-rounded')  # one thickness
    for z in range(6):
        rounded.add(f'{z}.dcm', z, SliceThickness=2 + z % 2 * 1e-3)
    whole(tool, rounded.folder)
    bolus = Series(tool, 'kinds-bolus')  # the agent comes after the first time
    for z in range(3):
        for t in range(3):
            bolus.add(f'{t}{z}.dcm', z, t, AcquisitionTime=f'1010{10 + t}', ContrastBolusAgent='Gd' if t else '')
    for t in range(3):
        whole(tool, bolus.folder, count=3, time=t, step=t, steps=3, times=[0.0, 1.0, 2.0])
    plain = Series(tool, 'kinds-numbers')  # nothing but the number
    for z in range(3):
        for n in range(2):
            plain.add(f'{n}{z}.dcm', z, n)
    whole(tool, plain.folder, count=3, time=1, step=1, steps=2)
    warned(tool, plain.folder, 'InstanceNumber', 'no times')


def check_told(tool):
    """Reports name what a series mixes, and the kind of its times."""
    zones = Series(tool, 'zones')
    made = Series(tool, 'made')
    mixed = Series(tool, 'mixed')
    for t, (clock, zone) in enumerate((('120000.0', '+0100'), ('110005.0', '+0000'), ('053010.0', '-0530'))):
        for z in range(3):
            number = 3 * t + z + 1
            zones.add(f'{number}.dcm', z, t, InstanceNumber=number, AcquisitionDateTime=f'20200101{clock}{zone}')
            made.add(f'{number}.dcm', z, t, InstanceNumber=number, ContentDate='20200101', ContentTime=f'12000{3 * t}')
            mixed.add(f'{number}.dcm', z, t, InstanceNumber=number, ContentDate='20200101', ContentTime=f'12000{9 - t}')
    whole(tool, zones.folder, count=3, step=2, time=2, times=[0.0, 5.0, 10.0], time_unit='s')
    whole(tool, made.folder, count=3, step=2, time=2, times=[0.0, 3.0, 6.0], time_unit='s')
    warned(tool, made.folder, 'ContentTime', 'no others')
    whole(tool, mixed.folder, count=3, step=2, time=2, steps=3)
    warned(tool, mixed.folder, 'InstanceNumber', 'ContentTime in another order')
    patients = Series(tool, 'patients')
    spaces = Series(tool, 'spaces')
    for z in range(6):
        patients.add(f'{z}.dcm', z, PatientID=str(z // 4))
        spaces.add(f'{z}.dcm', z, FrameOfReferenceUID=f'1.2.{z // 4}')
    whole(tool, patients.folder, count=4)
    warned(tool, patients.folder, 'Left out 2 other images', 'patient', '4.dcm, 5.dcm')
    whole(tool, spaces.folder)
    warned(tool, spaces.folder, 'places of 2 images', 'FrameOfReferenceUID', '4.dcm, 5.dcm')


def check_messages(tool):
    """Messages say what is wrong and nothing else."""
    for name, cosines in (('zero', [0, 0, 0, 0, 0, 0]), ('long', [2, 0, 0, 0, 2, 0])):
        wrong = stack(tool, f'turned-{name}', ImageOrientationPatient=cosines)
        tool.equal(wrong.folder, volume(6), spacing=[0.7, 0.5, 2.0], anatomy='')
        warned(tool, wrong.folder, 'ImageOrientationPatient', 'not of length 1')
    same = Series(tool, 'same')
    for n in range(4):
        same.add(f'{n}.dcm', 0, n, InstanceNumber=None)
    tool.refused(same.folder, '0.dcm and 1.dcm show the same place', 'InstanceNumber')
    offsets = (0, 2, 4, 7)
    dose = [files.Frame(f.values, position=(1, 2, 3 + n)) for f, n in zip(files.stack(4), offsets)]
    path = files.dose(tool.path('uneven dose.dcm'), dose, offsets)
    warned(tool, path, 'do not lie evenly', 'between 2 and 3 mm')
    info, _ = tool.dump(path)
    if any('missing' in text for text in info['warnings']):
        tool.fail(path, f'no slice is missing: {info["warnings"]}')
    offsets = (5, 7, 9, 11)  # neither from 0 nor from the height, which is 3
    dose = [files.Frame(f.values, position=(1, 2, 3 + n)) for f, n in zip(files.stack(4), offsets)]
    warned(tool, files.dose(tool.path('odd dose.dcm'), dose, offsets), 'neither 0 nor the height')
    tool.refused(files.changed(files.enhanced(tool.path('empty.dcm'), files.stack(1)), Rows=0), 'Rows or Columns is 0')
    path = files.enhanced(tool.path('groups.dcm'), files.stack(6))
    files.changed(path, PerFrameFunctionalGroupsSequence=pydicom.dcmread(path).PerFrameFunctionalGroupsSequence[:4])
    warned(tool, path, 'Left out 2 frames', '2 without a place from frame 5 on')


def check_words_of_sets(tool):
    """Descriptions in the character sets of DICOM choose their series; a label its segment."""
    study = tool.path('sets')
    names = (('ISO_IR 100', 'Schädel'), ('ISO_IR 101', 'głowa'), ('ISO_IR 144', 'Голова'), ('ISO_IR 126', 'κεφαλή'), ('ISO_IR 192', '頭部 ä'),
             ('GB18030', '头部'), (['', 'ISO 2022 IR 87'], '頭部 AX'), (['', 'ISO 2022 IR 149'], '머리'), (['ISO 2022 IR 13', 'ISO 2022 IR 87'], '頭 x'))
    for number, (charset, name) in enumerate(names):
        series = Series(tool, f'set{number}', study, SpecificCharacterSet=charset, SeriesDescription=name, SeriesNumber=100 + number)
        series.add(f'{number}.dcm', 0, number)
    for number, (_, name) in enumerate(names):
        whole(tool, f'{study}?series={name}', count=1, time=number)
    frames = [(n, files.Frame(numpy.full((4, 4), n - 1, 'u1'))) for n in (1, 2)]
    path = files.segmentation(tool.path('label.dcm'), frames, {1: 'other', 2: 'XX'})
    data = pydicom.dcmread(path)
    data.SpecificCharacterSet, data.SegmentSequence[1].SegmentLabel = ['', 'ISO 2022 IR 87'], '頭部'
    data.save_as(path)
    tool.equal(f'{path}?field=頭部', numpy.ones((1, 4, 4)), name='頭部')


def check_regions(tool):
    """An ultrasound image with several regions has the scale of the first region with cm."""
    def region(x, y, units=(3, 3)):
        return files.item(PhysicalUnitsXDirection=units[0], PhysicalUnitsYDirection=units[1], PhysicalDeltaX=x, PhysicalDeltaY=y)

    for regions, spacing, is_mixed in (([region(0.01, 0.02)], [0.1, 0.2, 1], False), ([region(0.01, 0.02)] * 2, [0.1, 0.2, 1], False),
                                       ([region(0.01, 0.01), region(0.03, 0.03)], [0.1, 0.1, 1], True),
                                       ([region(0.01, 2.0, (4, 7)), region(0.03, 0.03)], [0.3, 0.3, 1], True)):
        path = files.capture(tool.path('regions.dcm'), files.stack(2), Modality='US', SequenceOfUltrasoundRegions=regions)
        info, _ = tool.dump(path)
        tool.checks += 1
        if not numpy.allclose(info['spacing'], spacing) or info['unit'] != 'mm':
            tool.fail(path, f'spacing {info["spacing"]} {info["unit"]}, expected {spacing} mm')
        if any('several scales or units' in text for text in info['warnings']) != is_mixed:
            tool.fail(path, f'mixed regions: {is_mixed}, warnings: {info["warnings"]}')


def check(tool):
    warnings.filterwarnings('ignore', 'Invalid value for VR')  # of times that old files write
    for part in (check_midnight, check_scout, check_missing, check_gaps, check_twins, check_bare, check_words, check_mosaics, check_joined, check_bits, check_named, check_reconstructions,
                 check_told, check_messages, check_words_of_sets, check_regions):
        part(tool)
