# SPDX-License-Identifier: Apache-2.0
"""Folders of DICOM files: series, times, places, strays, copies and damage. The files are written with pydicom; the expected
samples and places come from the numbers that they are made of."""
import os
import random
import shutil

import numpy
import pydicom
from pydicom.dataset import Dataset, FileMetaDataset
from pydicom.uid import CTImageStorage, ExplicitVRLittleEndian, RLELossless, generate_uid

NX, NY = 10, 8
SPACING = (0.7, 0.5, 2.0)
AXIAL = (1, 0, 0, 0, 1, 0)
CORONAL = (1, 0, 0, 0, 0, -1)


def pixels(z, time=0):
    """The samples of a slice: its number tells place, time and pixel."""
    return (numpy.arange(NX * NY, dtype='u2').reshape(NY, NX) + NX * NY * z + 1000 * time)


def volume(count, time=0):
    return numpy.stack([pixels(z, time) for z in range(count)])


class Series:
    """Writes the slices of one series into a folder."""

    def __init__(self, tool, name, folder=None, **tags):
        self.folder = folder or tool.path(name)
        os.makedirs(self.folder, exist_ok=True)
        self.uid = generate_uid(entropy_srcs=['splatd', name])[:56]
        self.tags, self.written = {'Modality': 'MR', 'SeriesNumber': 1, **tags}, 0

    def path(self, name):
        return os.path.join(self.folder, name)

    def dataset(self, samples, z, **tags):
        d = Dataset()
        d.file_meta = FileMetaDataset()
        d.file_meta.TransferSyntaxUID = ExplicitVRLittleEndian
        d.file_meta.MediaStorageSOPClassUID = d.SOPClassUID = CTImageStorage
        self.written += 1
        d.SOPInstanceUID = f'{self.uid}.{self.written}'
        d.file_meta.MediaStorageSOPInstanceUID = d.SOPInstanceUID
        d.StudyInstanceUID, d.SeriesInstanceUID = f'{self.uid}.0', self.uid
        d.Rows, d.Columns = samples.shape
        d.PixelSpacing, d.SliceThickness = [SPACING[1], SPACING[0]], SPACING[2]
        d.ImageOrientationPatient, d.ImagePositionPatient = list(AXIAL), [5, 6, SPACING[2] * z]
        d.InstanceNumber = self.written
        d.SamplesPerPixel, d.PhotometricInterpretation = 1, 'MONOCHROME2'
        d.BitsAllocated, d.BitsStored, d.HighBit, d.PixelRepresentation = 16, 16, 15, 0
        d.PixelData = samples.astype('<u2').tobytes()
        for key, value in {**self.tags, **tags}.items():
            if value is None:
                d.pop(key, None)
            else:
                setattr(d, key, value)
        return d

    def add(self, name, z, time=0, samples=None, **tags):
        d = self.dataset(pixels(z, time) if samples is None else samples, z, **tags)
        d.save_as(self.path(name), enforce_file_format=True)
        return self.path(name)


def stack(tool, name, count=6, **tags):
    """A folder of slices 00.dcm, 01.dcm, …"""
    series = Series(tool, name, **tags)
    for z in range(count):
        series.add(f'{z:02}.dcm', z)
    return series


def whole(tool, source, count=6, time=0, step=None, **wanted):
    tool.equal(source, volume(count, time), step=step, **{'spacing': list(SPACING), 'origin': [5, 6, 0], **wanted})


def warned(tool, source, *words, step=None):
    """The warnings have these words."""
    info, _ = tool.dump(source, step)
    tool.checks += 1
    told = ' | '.join(info['warnings']) if info else ''
    if not all(word in told for word in words):
        tool.fail(source, f'expected warnings with {words}, got: {told}')


def silent(tool, source):
    info, _ = tool.dump(source)
    tool.checks += 1
    if info and info['warnings']:
        tool.fail(source, f'expected no warning, got: {info["warnings"]}')


def check_strays(tool):
    series = Series(tool, 'strays')
    for z in range(6):
        series.add(f'I{z}', z)  # without an extension
    for name, text in (('A.jpg', b'\xff\xd8 broken'), ('LICENSE.txt', b'text'), ('.DS_Store', b'\0\0\0\1Bud1'), ('._I0', b'\0\5\x16\7'),
                       ('Thumbs.db', b'\xd0\xcf\x11\xe0'), ('0.json', b'{}'), ('a.csv', b'x,y\n1,2\n'), ('0readme', b'text')):
        with open(series.path(name), 'wb') as file:
            file.write(text)
    whole(tool, series.folder)
    silent(tool, series.folder)
    whole(tool, series.path('I3'))
    tool.equal(series.path('I3') + '?as=slice', volume(6)[3:4], origin=[5, 6, 6])
    tool.refused(series.folder + '?as=slice', 'not a single slice')


def check_directory(tool):
    from pydicom.fileset import FileSet
    study = Series(tool, 'directory-study')
    small = Series(tool, 'directory-small', SeriesNumber=2)
    files = FileSet()
    for one, count in ((study, 6), (small, 3)):
        for z in range(count):
            files.add(one.dataset(pixels(z), z, PatientID='p', StudyDate='20200101', StudyTime='101010', StudyID='1'))
    for one in (study, small):
        shutil.rmtree(one.folder)
    folder = tool.path('directory')
    files.write(folder)
    source = os.path.join(folder, 'DICOMDIR')
    whole(tool, source)
    warned(tool, source, 'largest of 2', '2 (3 images)')
    whole(tool, folder)
    whole(tool, f'{source}?series=2', count=3)
    alone = tool.path('directory-alone')
    os.makedirs(alone)
    shutil.copy(source, alone)
    tool.refused(os.path.join(alone, 'DICOMDIR'), 'no DICOM image')
    beside = stack(tool, 'directory-beside')
    shutil.copy(source, beside.folder)
    whole(tool, beside.folder)
    silent(tool, beside.folder)
    whole(tool, beside.path('DICOMDIR'))


def check_copies(tool):
    series = stack(tool, 'copies')
    shutil.copy(series.path('03.dcm'), series.path('03 (copy).dcm'))
    for source in (series.folder, series.path('03 (copy).dcm'), series.path('00.dcm')):
        whole(tool, source)
    warned(tool, series.folder, '1 copy', 'SOPInstanceUID', '03 (copy).dcm (of 03.dcm)')
    careless = stack(tool, 'careless', SOPInstanceUID='1.2.3')  # all slices have one id
    whole(tool, careless.folder)
    silent(tool, careless.folder)


def check_series(tool):
    folder = tool.path('several')
    small = Series(tool, 'several-a', folder, SeriesNumber=4, SeriesDescription='T1 fast')
    large = Series(tool, 'several-b', folder, SeriesNumber=7, SeriesDescription='T2 space')
    for z in range(3):
        small.add(f'a{z}.dcm', z)
    for z in range(6):
        large.add(f'b{z}.dcm', z, time=1)
    scout = large.add('scout.dcm', 0, samples=pixels(0)[:4], SeriesNumber=7)
    coronal = large.add('coronal.dcm', 0, ImageOrientationPatient=list(CORONAL))
    whole(tool, folder, time=1)
    warned(tool, folder, '7 "T2 space" (6 images)', 'largest of 2', '4 "T1 fast" (3 images)', '2 other images', 'coronal.dcm', 'scout.dcm')
    for wanted in ('4', small.uid, 'T1 fast', 't1 FAST', 'fast'):
        whole(tool, f'{folder}?series={wanted}', count=3)
    whole(tool, f'{folder}?series=7', time=1)
    tool.refused(f'{folder}?series=9', 'no series "9"', '7 "T2 space"', '4 "T1 fast"')
    whole(tool, os.path.join(folder, 'a1.dcm'), count=3)
    tool.refused(os.path.join(folder, 'a1.dcm') + '?series=7', 'belongs to the series')
    tool.equal(scout, pixels(0)[None, :4])
    tool.equal(coronal, pixels(0)[None])
    whole(tool, os.path.join(folder, 'b5.dcm'), time=1)


def check_unnamed_series(tool):
    """Series without number and description are told apart by the end of their UID; a long list leaves its remedy."""
    folder = tool.path('unnamed')
    both = [Series(tool, f'unnamed-{i}', folder, SeriesNumber=None) for i in range(2)]
    for i, one in enumerate(both):
        for z in range(2 + i):
            one.add(f'{i}{z}.dcm', z, i)
    warned(tool, folder, f'MR …{both[1].uid[-12:]} (3 images)', f'MR …{both[0].uid[-12:]} (2 images)', 'UID.')
    whole(tool, f'{folder}?series={both[0].uid[-12:]}', count=2)
    twins = tool.path('twins')  # of the same number
    for i in range(2):
        Series(tool, f'twins-{i}', twins, SeriesNumber=1, SeriesDescription='AB'[i]).add(f'{i}.dcm', 0)
    warned(tool, f'{twins}?series=1', 'the largest of 2', '"B"')
    silent(tool, f'{twins}?series=A')
    many = tool.path('many')
    for i in range(9):
        Series(tool, f'many-{i}', many, SeriesNumber=i, SeriesDescription=f'Long name & number {i} of Ü & T1*').add(f'{i}.dcm', 0)
    tool.equal(f'{many}?series=long NAME & number 3 of Ü & T1*&unit=um', pixels(0)[None], unit='um')
    warned(tool, many, 'largest of 9', ' more. ?series= chooses by number, description or UID.')


def check_folders(tool):
    study = tool.path('study')
    for name, number, count, time in (('SE0', 1, 3, 0), ('SE1', 2, 6, 1), ('deep/er/SE2', 3, 2, 2)):
        series = Series(tool, f'study-{number}', os.path.join(study, name), SeriesNumber=number)
        for z in range(count):
            series.add(f'IM{z}', z, time)
    with open(os.path.join(study, 'LICENSE.txt'), 'w', encoding='ascii') as file:
        file.write('text')
    whole(tool, study, time=1)
    warned(tool, study, 'largest of 3', '1 (3 images)', '3 (2 images)')
    whole(tool, f'{study}?series=3', count=2, time=2)
    split = tool.path('split')  # one series, one folder per slice
    series = Series(tool, 'split-series', split)
    for z in range(6):
        os.makedirs(os.path.join(split, f'{z}'))
        series.add(f'{z}/IM', z)
    whole(tool, split)
    empty = tool.path('empty')
    os.makedirs(os.path.join(empty, 'sub'))
    tool.refused(empty, 'no DICOM image')


def check_damage(tool):
    series = stack(tool, 'damage', count=9)
    with open(series.path('06.dcm'), 'r+b') as file:
        file.truncate(os.path.getsize(file.name) - 40)
    with open(series.path('07.dcm'), 'r+b') as file:
        file.truncate(200)
    with open(series.path('08.dcm'), 'r+b') as file:
        file.truncate(0)
    whole(tool, series.folder)
    whole(tool, series.path('02.dcm'))
    warned(tool, series.folder, '3 files', '06.dcm', '07.dcm', '08.dcm')
    tool.refused(series.path('06.dcm'), 'cut off')
    packed = Series(tool, 'damage-packed')
    for z in range(8):
        one = packed.dataset(pixels(z), z)
        one.compress(RLELossless)
        one.save_as(packed.path(f'I{z}'), enforce_file_format=True)
    with open(packed.path('I6'), 'r+b') as file:
        file.truncate(os.path.getsize(file.name) - 60)
    with open(packed.path('I7'), 'r+b') as file:
        file.write(bytes(os.path.getsize(file.name)))
    whole(tool, packed.folder)
    warned(tool, packed.folder, '2 files', 'I6', 'I7')
    with open(packed.path('I3'), 'r+b') as file:  # the fragments are whole, the pixels are not
        file.seek(-100, os.SEEK_END)
        file.write(b'\x81' * 80)
    tool.equal(packed.folder, [pixels(z) if z != 3 else numpy.zeros((NY, NX)) for z in range(6)])
    warned(tool, packed.folder, '1 slice is damaged and shown as 0', 'I3')


def check_mixtures(tool):
    mixed = Series(tool, 'mixed')
    for z in range(6):
        one = mixed.dataset(pixels(z), z, BitsStored=12 + z % 3 * 2, HighBit=11 + z % 3 * 2)
        if z % 2:
            one.compress(RLELossless)
        one.save_as(mixed.path(f'{z}.dcm'), enforce_file_format=True)
    whole(tool, mixed.folder)
    slopes = Series(tool, 'slopes')
    for z in range(6):
        slopes.add(f'{z}.dcm', z, RescaleSlope=0.5 * (z + 1), RescaleIntercept=-z)
    tool.equal(slopes.folder, [pixels(z) * 0.5 * (z + 1) - z for z in range(6)])
    sizes = Series(tool, 'sizes')
    for z in range(6):
        sizes.add(f'{z}.dcm', z)
    for z in range(2):
        sizes.add(f's{z}.dcm', z, PixelSpacing=[1, 1])
    whole(tool, sizes.folder)
    warned(tool, sizes.folder, '2 other images', 's0.dcm')
    unplaced = Series(tool, 'unplaced')
    order = list(range(6))
    random.Random(3).shuffle(order)
    for z in order:
        unplaced.add(f'{5 - z}.dcm', z, ImagePositionPatient=None, InstanceNumber=z + 1)
    whole(tool, unplaced.folder, origin=[0, 0, 0])
    warned(tool, unplaced.folder, 'no position')


def check_places(tool):
    jitter = Series(tool, 'jitter')
    for z, off in enumerate((0, 0.02, -0.02, 0.01, 0.02, -0.01)):
        jitter.add(f'{z}.dcm', z, ImagePositionPatient=[5, 6, 1.6 * z + off])
    whole(tool, jitter.folder, spacing=[0.7, 0.5, 1.598])
    info, _ = tool.dump(jitter.folder)
    if info and 'coordinates2' in info:
        tool.fail(jitter.folder, f'the slices are not even: {info["coordinates2"]}')
    warned(tool, jitter.folder, 'not quite even', '0.0', '1.598 mm apart')
    gap = Series(tool, 'gap')
    for z in (0, 1, 2, 5, 6):
        gap.add(f'{z}.dcm', z)
    tool.equal(gap.folder, [pixels(z) for z in (0, 1, 2, 5, 6)], coordinates2=[0, 2, 4, 10, 12])
    warned(tool, gap.folder, '2 slices are missing at 7 mm', '2.dcm and 5.dcm')
    tilt = Series(tool, 'tilt')
    angle = numpy.radians(15)
    for z in range(6):
        tilt.add(f'{z}.dcm', z, ImagePositionPatient=[5, 6, 2 * z], ImageOrientationPatient=[1, 0, 0, 0, numpy.cos(angle), -numpy.sin(angle)],
                 GantryDetectorTilt=15)
    info, _ = tool.dump(tilt.folder)
    tool.checks += 1
    expected = [[1, 0, 0], [0, 0.9659, 0], [0, -0.2588, 1]]
    if info and not numpy.allclose(numpy.reshape(info['direction'], (3, 3)), expected, atol=1e-4):
        tool.fail(tilt.folder, f'the direction is {info["direction"]}')
    shifted = Series(tool, 'shifted')
    for z in range(6):
        shifted.add(f'{z}.dcm', z, ImagePositionPatient=[5 + (3 if z == 2 else 0), 6, 2 * z])
    warned(tool, shifted.folder, 'not lie on a line', '3 mm')
    backward = Series(tool, 'backward')
    for z in range(6):
        backward.add(f'{5 - z}.dcm', z, InstanceNumber=6 - z)
    whole(tool, backward.folder)


TIMES = {  # the tags of step t of slice z, the times of the steps
    'temporal': (lambda z, t: {'TemporalPositionIdentifier': t + 1, 'TemporalResolution': 1500}, [0, 1.5, 3]),
    'trigger': (lambda z, t: {'TriggerTime': 40 * t + z}, [0, 0.04, 0.08]),
    'acquisition': (lambda z, t: {'AcquisitionTime': f'1010{10 + 2 * t:02}.5'}, [0, 2, 4]),
    'slices': (lambda z, t: {'AcquisitionTime': f'1010{10 + 20 * t + z:02}.0'}, [0, 20, 40]),
    'acquisitions': (lambda z, t: {'AcquisitionNumber': t + 1}, None),
    'frame': (lambda z, t: {'FrameReferenceTime': 60000.0 * t + 30000}, [30, 90, 150]),
    'number': (lambda z, t: {}, None),
}


def check_times(tool):
    rng = random.Random(5)
    for name, (tags, times) in TIMES.items():
        for is_shuffled in (False, True):
            series = Series(tool, f'time-{name}-{is_shuffled}')
            slices = [(z, t) for t in range(3) for z in range(4)]
            names = list(range(12))
            rng.shuffle(names)
            for n, (z, t) in zip(names, slices):
                has_numbers = name == 'number' or not is_shuffled
                series.add(f'IM{n if is_shuffled else z * 3 + t:04}.dcm', z, t, InstanceNumber=z * 3 + t + 1 if has_numbers else None, **tags(z, t))
            for step in range(3):
                whole(tool, series.folder, count=4, time=step, step=step)
            n, (z, t) = names[0] if is_shuffled else 5, slices[0] if is_shuffled else (1, 2)
            whole(tool, series.path(f'IM{n:04}.dcm'), count=4, time=t, step_shown=t)  # without `step`, the file's own step
            whole(tool, series.path(f'IM{n:04}.dcm'), count=4, time=1, step=1, step_shown=1)
            info, _ = tool.dump(series.path('IM0001.dcm'))
            tool.checks += 1
            got = info and info.get('times')
            if info and (info['steps'] != 3 or (times and not (got and numpy.allclose(got, times)))):
                tool.fail(series.folder, f'{info["steps"]} steps, times {got}, expected {times}')


def check_fields(tool):
    """Images of one place that differ in what they show, not in their time, become fields."""
    for name, key, values, names in (('echo', 'EchoTime', (5, 10), ('echo 5 ms', 'echo 10 ms')),
                                     ('diffusion', 'DiffusionBValue', (0.0, 800.0), ('b 0 s/mm²', 'b 800 s/mm²')),
                                     ('type', 'ImageType', (['ORIGINAL', 'PRIMARY', 'M'], ['ORIGINAL', 'PRIMARY', 'P']), ('M', 'P'))):
        series = Series(tool, f'field-{name}')
        for z in range(4):
            for t in range(2):
                series.add(f'{t}{z}.dcm', z, t, **{key: values[t]})
        for t in range(2):
            whole(tool, f'{series.folder}?field={names[t]}', count=4, time=t, name=names[t])
            whole(tool, series.path(f'{t}2.dcm'), count=4, time=t, name=names[t])  # the field of the file


def check_uneven_times(tool):
    aborted = Series(tool, 'aborted')  # the last time has two of four places
    for t in range(3):
        for z in range(4 if t < 2 else 2):
            aborted.add(f'{t}{z}.dcm', z, t, AcquisitionTime=f'1010{10 + t}')
    for step in range(2):
        whole(tool, aborted.folder, count=4, time=step, step=step)
    warned(tool, aborted.folder, '2 images', 'incomplete')
    for step in range(3):  # a file that is opened by its name stays: the places of its time
        whole(tool, aborted.path('21.dcm'), count=2, time=step, step=step, steps=3)
    warned(tool, aborted.path('21.dcm'), '4 images', 'places that lack times')
    twice = Series(tool, 'twice')  # the last two times lack different places
    for z, t in [(z, t) for z in range(3) for t in range(4) if (z, t) not in ((1, 3), (2, 2))]:
        twice.add(f'{t}{z}.dcm', z, t, TemporalPositionIdentifier=t + 1)
    whole(tool, twice.folder, count=3, time=1, step=1, steps=2)
    whole(tool, twice.path('21.dcm'), count=2, time=2, steps=1)
    warned(tool, twice.path('21.dcm'), '8 images of other times than that of the file')
    hole = Series(tool, 'hole')  # time 1 lacks a place; only the identifier tells
    for z in range(4):
        for t in range(3):
            if (z, t) != (2, 1):
                hole.add(f'{t}{z}.dcm', z, t, TemporalPositionIdentifier=t + 1)
    for step, time in ((0, 0), (1, 2)):
        whole(tool, hole.folder, count=4, time=time, step=step)
    warned(tool, hole.folder, 'incomplete')
    unknown = Series(tool, 'unknown')
    for z in range(4):
        for t in range(3):
            if (z, t) != (2, 1):
                unknown.add(f'{t}{z}.dcm', z, t, InstanceNumber=None)
    tool.refused(unknown.folder, 'show the same place', 'nothing tells which times')


def check_simpleitk(tool):
    """The world of each index, against SimpleITK on a turned series."""
    try:
        import SimpleITK
    except ImportError:
        tool.skipped.append('SimpleITK is not installed')
        return
    turned = Series(tool, 'turned')
    along = numpy.linalg.qr(numpy.array([[1, 0.2, 0.1], [-0.3, 1, 0.2], [0.1, -0.1, 1]]))[0]
    for z in range(6):
        turned.add(f'{z}.dcm', z, ImageOrientationPatient=[f'{n:.10f}' for n in along[:, :2].T.ravel()],
                   ImagePositionPatient=[f'{n:.8f}' for n in 3 + 2 * z * numpy.cross(along[:, 0], along[:, 1])])
    names = SimpleITK.ImageSeriesReader.GetGDCMSeriesFileNames(turned.folder)
    image = SimpleITK.ReadImage(names)
    tool.equal(turned.folder, SimpleITK.GetArrayFromImage(image), spacing=list(image.GetSpacing()), origin=list(image.GetOrigin()))
    info, _ = tool.dump(turned.folder)
    if info and not numpy.allclose(info['direction'], image.GetDirection(), atol=1e-6):
        tool.fail(turned.folder, f'direction {info["direction"]}, expected {image.GetDirection()}')


def check(tool):
    for part in (check_strays, check_directory, check_copies, check_series, check_unnamed_series, check_folders, check_damage, check_mixtures, check_places, check_times,
                 check_fields, check_uneven_times, check_simpleitk):
        part(tool)
