/* SPDX-License-Identifier: Apache-2.0 */
#include "import/dicom_frames.h"

#include "base/vec.h"

bool dicom_frames_list(const struct dicom_source *source, struct dicom_slices *slices,
                       struct sp_error *err) {
    const struct dicom_image *image = &source->image;
    const struct sp_vec3 normal =
        sp_vec3_cross(sp_vec3_from(image->first.along[0]), sp_vec3_from(image->first.along[1]));
    for (uint32_t i = 0; i < image->frames; i++) {
        struct dicom_frame is = image->first;
        for (int row = 0; row < 3; row++)
            is.position[row] += normal.v[row] * i * (is.spacing[2] > 0 ? is.spacing[2] : 1);
        is.instance = (long)i + 1;
        if (!dicom_slices_add(slices, "", i, &is))
            return sp_fail(err, SP_ERR_MEMORY, source->file->shown, "out of memory for the frames");
    }
    return true;
}
