# SPDX-License-Identifier: Apache-2.0
"""Series that are more than slices of one type at one time: mosaics, several files with frames, reconstructions of one scan, times across midnight."""
import os
import warnings

import numpy

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
        for t in range(3):
            whole(tool, series.folder, count=3, time=t, step=t, times=[0.0, 3.0, 6.0])
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
    """What a file does not say about places is told, with what is shown instead."""
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


def check(tool):
    warnings.filterwarnings('ignore', 'Invalid value for VR')  # of times that old files write
    for part in (check_midnight, check_scout, check_missing):
        part(tool)
