/* SPDX-License-Identifier: Apache-2.0
 *
 * Outputs that are folders: written under a temporary name, and renamed when they are complete.
 */
#ifndef SP_EXPORT_FOLDER_H
#define SP_EXPORT_FOLDER_H

#include "data/export/job.h"

/* True if the path of the output does not exist, or is a folder that convert wrote, which may be
 * replaced. Otherwise SP_ERR_INVALID. */
bool sp_export_check_folder(const char *out, struct sp_error *err);

/* Makes a folder "OUT.PID.part" as job->out, calls write(), and names the folder OUT = job->title.
 * On failure the folder is removed. SP_ERR_IO and the errors of write(). */
bool sp_export_folder(struct sp_export_job *job, sp_export_fn *write, struct sp_error *err);

#endif
