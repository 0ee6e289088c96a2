// SPDX-License-Identifier: Apache-2.0
//
// Exceptions of the C++ libraries that modules use (module.h), as errors.
#ifndef SP_IMPORT_EXCEPTION_H
#define SP_IMPORT_EXCEPTION_H

#include <exception>
#include <new>

#include "sp/status.h"

/* Fills *err with SP_ERR_MEMORY; returns false. */
inline bool import_fail_memory(sp_error *err) {
    return sp_fail(err, SP_ERR_MEMORY, "",
                   "out of memory: reading may take 1 GiB beside the samples");
}

/* Fills *err in a handler and returns false: SP_ERR_MEMORY if an allocation failed. Otherwise
 * explain() fills it from the text of the exception. */
inline bool import_fail_caught(sp_error *err, const std::exception &e,
                               bool (*explain)(sp_error *err, const char *text)) {
    return dynamic_cast<const std::bad_alloc *>(&e) ? import_fail_memory(err)
                                                    : explain(err, e.what());
}

#endif
