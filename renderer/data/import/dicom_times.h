/* SPDX-License-Identifier: Apache-2.0
 *
 * Times of slices: scans across midnight, and places that have different numbers of slices, as in
 * a scan that was stopped.
 */
#ifndef SP_IMPORT_DICOM_TIMES_H
#define SP_IMPORT_DICOM_TIMES_H

#include "data/import/dicom_slices.h"

/* Where no slice has a date, adds a day to times of day after midnight: those before a gap of more
 * than half a day. */
void dicom_times_pass_midnight(struct dicom_slices *slices);

/* Leaves out the times that lack places, or else the places that lack times, whichever leaves more,
 * and warns of it. The image that was opened by its name stays. The slices are sorted before and
 * after. Does nothing if nothing tells the times apart. Fails without memory. */
bool dicom_times_complete(struct dicom_slices *slices, const struct dicom_source *source,
                          struct sp_error *err);

#endif
