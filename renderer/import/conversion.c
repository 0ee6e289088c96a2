/* SPDX-License-Identifier: Apache-2.0 */
#include "import/conversion.h"

#include <math.h>
#include <stdint.h>

#include "volume/sample.h"

struct import_conversion import_conversion_of(struct import_number number) {
    struct import_conversion c = { .number = number, .components = 1, .slope = 1 };
    double low, high;
    import_number_range(number, &low, &high);
    import_conversion_choose(&c, low, high);
    return c;
}

void import_conversion_choose(struct import_conversion *c, double low, double high) {
    static const enum sp_type whole[] = { SP_UINT8, SP_INT8, SP_UINT16, SP_INT16, SP_INT32 };
    const double ends[2] = { c->slope * low + c->offset, c->slope * high + c->offset };
    const bool is_whole = trunc(c->slope) == c->slope && trunc(c->offset) == c->offset;
    if (c->number.kind == IMPORT_FLOAT) {
        c->type = c->number.size == 4 ? SP_FLOAT32 : SP_FLOAT64;
        return;
    }
    c->type = c->number.size <= 2 ? SP_FLOAT32 : SP_FLOAT64;
    for (size_t i = 0; is_whole && i < sizeof whole / sizeof *whole; i++) {
        double least, most;
        import_number_range(import_number_of(whole[i]), &least, &most);
        if (fmin(ends[0], ends[1]) >= least && fmax(ends[0], ends[1]) <= most) {
            c->type = whole[i];
            return;
        }
    }
}

bool import_conversion_is_copy(const struct import_conversion *c) {
    const struct import_number same = import_number_of(c->type);
    return c->components == 1 && c->slope == 1 && c->offset == 0 && same.kind == c->number.kind &&
           same.size == c->number.size;
}

void import_conversion_put(const struct import_conversion *c, const void *numbers, size_t count,
                           void *out) {
    const char *at = (const char *)numbers + c->component * c->number.size;
    const struct import_number to = import_number_of(c->type);
    double least, most;
    import_number_range(to, &least, &most);
    for (size_t i = 0; i < count; i++, at += c->components * c->number.size) {
        double sample = c->slope * import_widen(at, c->number) + c->offset;
        if (to.kind != IMPORT_FLOAT)
            sample = fmin(fmax(sample, least), most);
        sp_sample_set(out, c->type, i, sample);
    }
}
