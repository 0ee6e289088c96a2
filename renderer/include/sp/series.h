/* SPDX-License-Identifier: Apache-2.0
 *
 * The series of a DICOM folder. sp_volume_load() opens the largest one, or that of the file; the
 * source "PATH?series=UID" opens another one.
 */
#ifndef SP_SERIES_H
#define SP_SERIES_H

#include "sp/volume.h"

#ifdef __cplusplus
extern "C" {
#endif

enum { SP_SERIES_MAX = 1024 }; /* of one list */

struct sp_series {
    char uid[68];         /* SeriesInstanceUID; "" = the files have none */
    char description[68]; /* UTF-8; "" = none */
    char modality[20];    /* "CT", "MR", …; "" = none */
    bool has_number;
    int32_t number;         /* of the series in its study */
    uint32_t images;        /* of all its files: slices, times, frames */
    uint32_t columns, rows; /* of most images */
    uint64_t bytes;         /* of its files */
};

/* Lists the series of a folder, of the sub-folders of a folder without images, or of the folders
 * below a DICOMDIR, by their numbers. *count = how many there are, at most SP_SERIES_MAX; 0 = the
 * source is no DICOM. `list` holds SP_SERIES_MAX. Of the options only root, importer and
 * timeout_ms are used; NULL = none. Reads the header of each file, in the sandbox of the importer,
 * and blocks until it is done. Errors are those of sp_volume_load(). Any thread. */
SP_API bool sp_series_list(const char *path, const struct sp_load_options *options,
                           struct sp_series *list, uint32_t *count, struct sp_error *err);

#ifdef __cplusplus
}
#endif

#endif
