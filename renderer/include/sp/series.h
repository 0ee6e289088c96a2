/* SPDX-License-Identifier: Apache-2.0
 *
 * The series of a DICOM folder. sp_volume_load() opens the largest series of a folder, or the
 * series of a file. The source "PATH?series=UID" opens another series.
 */
#ifndef SP_SERIES_H
#define SP_SERIES_H

#include "sp/volume.h"

#ifdef __cplusplus
extern "C" {
#endif

enum { SP_SERIES_MAX = 1024 }; /* series in one list */

struct sp_series {
    char uid[68];         /* SeriesInstanceUID; "" = the files have none */
    char description[68]; /* UTF-8; "" = none */
    char modality[20];    /* "CT", "MR", …; "" = none */
    bool has_number;
    int32_t number;         /* number of the series in its study */
    uint32_t images;        /* images in all files of the series: slices, times, frames */
    uint32_t columns, rows; /* size of most images, px */
    uint64_t bytes;         /* total size of its files */
};

/* Lists the series of a folder, of the sub-folders of a folder without images, or of the folders
 * below a DICOMDIR. The list is sorted by series number. `list` has space for SP_SERIES_MAX series;
 * *count is the number of series; 0 = the source is no DICOM. Only the options root, importer and
 * timeout_ms are used; `options` may be NULL. The importer reads the header of each file in its
 * sandbox. The function blocks until the list is complete. Errors are those of sp_volume_load().
 * Any thread. */
SP_API bool sp_series_list(const char *path, const struct sp_load_options *options,
                           struct sp_series *list, uint32_t *count, struct sp_error *err);

#ifdef __cplusplus
}
#endif

#endif
