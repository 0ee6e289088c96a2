/* SPDX-License-Identifier: Apache-2.0 */
#include "import/launch.h"
#include "volume/procedural.h"

struct sp_volume *sp_volume_load(const char *source, const struct sp_load_options *options,
                                 struct sp_error *err) {
    if (sp_source_is_demo(source))
        return sp_demo_load(source, options, err);
    return sp_import(source, options, err);
}
