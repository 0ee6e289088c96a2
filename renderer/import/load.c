/* SPDX-License-Identifier: Apache-2.0 */
#include "volume/procedural.h"

struct sp_volume *sp_volume_load(const char *source, const struct sp_load_options *options,
                                 struct sp_error *err) {
    if (sp_source_is_demo(source))
        return sp_demo_load(source, options, err);
    sp_fail(err, SP_ERR_UNSUPPORTED, source, "this build reads built-in volumes (demo:NAME) alone");
    return NULL;
}
