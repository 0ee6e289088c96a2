/* SPDX-License-Identifier: Apache-2.0
 *
 * Volumes of labels: numbers of categories, which have no order.
 */
#ifndef SP_DEFAULT_VIEW_LABELS_H
#define SP_DEFAULT_VIEW_LABELS_H

#include "sp/view.h"

/* True if the file says so, or if the samples look like it: whole numbers, few of them or many, and
 * nearly all neighbours of a sample have its number. */
bool sp_default_are_labels(const struct sp_volume *volume);

/* A colour for each label, which depends on its number alone; 0 is transparent. The transfer
 * function classifies voxels, because between two labels there is no third. False without memory,
 * or if there is no label; the view is unchanged then. */
bool sp_default_show_labels(const struct sp_volume *volume, struct sp_view *view);

#endif
