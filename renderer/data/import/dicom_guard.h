// SPDX-License-Identifier: Apache-2.0
//
// GDCM ends the process with abort() where an assertion of its own does not hold, as for most
// files that are cut off, and its decoders crash on some damaged pixels. One damaged slice must not
// end the import of the others: a guarded call returns instead. Objects that it had made are lost,
// which a process that lives for one import can afford.
#ifndef SP_IMPORT_DICOM_GUARD_H
#define SP_IMPORT_DICOM_GUARD_H

#include "sp/status.h"

/* Returns run(user), or false with *err set if GDCM gave up. */
bool dicom_survive(bool (*run)(void *user), void *user, sp_error *err);

template <typename Call> bool dicom_guard(Call call, sp_error *err) {
    return dicom_survive([](void *user) -> bool { return (*static_cast<Call *>(user))(); }, &call,
                         err);
}

#endif
