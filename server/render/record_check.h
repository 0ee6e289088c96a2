/* SPDX-License-Identifier: Apache-2.0 */
#ifndef SRV_RENDER_RECORD_CHECK_H
#define SRV_RENDER_RECORD_CHECK_H

#include "sp/status.h"
#include "store/kind.h"

#include <stddef.h>

/* Checks the text of a record of a saved view or a preset, because these are read only when a
 * request needs them. Records of other kinds are checked when they are restored. SP_ERR_FORMAT,
 * SP_ERR_INVALID (with a JSON pointer), SP_ERR_MEMORY. */
bool srv_record_check(enum srv_kind kind, const char *text, size_t size, struct sp_error *err);

#endif
