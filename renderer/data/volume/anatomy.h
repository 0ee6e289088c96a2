/* SPDX-License-Identifier: Apache-2.0
 *
 * Anatomical directions of the world axes, as in sp_volume_info.anatomy: "LPS" says that +x points
 * to the patient's left, +y to the back (posterior) and +z to the head (superior).
 */
#ifndef SP_VOLUME_ANATOMY_H
#define SP_VOLUME_ANATOMY_H

#include <stdbool.h>

#include "sp/volume.h"

/* True if the letters are three of R L A P S I, one per pair of opposites, or none at all. The
 * string must end within its four bytes. */
bool sp_anatomy_is_valid(const char letters[4]);

/* Writes the world vector that points to a direction, such as 'S'. False if the letters do not
 * state this direction. */
bool sp_anatomy_find(const char letters[4], char direction, double vector[3]);

/* True if axes with these letters are left-handed, and so show the patient as in a mirror: "LAS" is
 * left-handed, "LPS" and "RAS" are not. */
bool sp_anatomy_is_left_handed(const char letters[4]);

/* True if the file states nothing about the place of its grid: a stack of images without an
 * orientation. Scans are usually stored from the head down. False for a built-in volume. */
bool sp_anatomy_is_plain_stack(const struct sp_volume_info *info);

#endif
