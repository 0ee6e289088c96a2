/* SPDX-License-Identifier: Apache-2.0 */
#include "session/measures.h"

#include <stdlib.h>
#include <string.h>

enum srv_measure_effort srv_measure_effort_of(enum sp_measure_kind kind) {
    if (sp_measure_has_range(kind))
        return SRV_MEASURE_LONG;
    return kind == SP_MEASURE_DISTANCE || kind == SP_MEASURE_ANGLE ? SRV_MEASURE_AT_ONCE
                                                                   : SRV_MEASURE_SOON;
}

struct srv_measure_item *srv_measures_find(const struct srv_measures *measures, const char *id) {
    for (size_t i = 0; i < measures->count; i++)
        if (strcmp(measures->items[i].measure.id, id) == 0)
            return &measures->items[i];
    return NULL;
}

static bool reserve(struct srv_measures *measures, struct sp_error *err) {
    if (measures->count >= SRV_MEASURES_MAX)
        return sp_fail(err, SP_ERR_QUOTA, NULL,
                       "the session has %zu measurements and may have %d; remove some",
                       measures->count, SRV_MEASURES_MAX);
    if (measures->count < measures->capacity)
        return true;
    const size_t capacity = measures->capacity ? measures->capacity * 2 : 4;
    struct srv_measure_item *items = realloc(measures->items, capacity * sizeof *items);
    if (!items)
        return sp_fail(err, SP_ERR_MEMORY, NULL, "out of memory for a measurement");
    measures->items = items;
    measures->capacity = capacity;
    return true;
}

bool srv_measures_put(struct srv_measures *measures, const struct proto_measure *measure,
                      struct sp_error *err) {
    struct srv_measure_item *item = srv_measures_find(measures, measure->id);
    if (!item && !reserve(measures, err))
        return false;
    if (!item)
        item = &measures->items[measures->count++];
    *item = (struct srv_measure_item){ .measure = *measure, .clock = ++measures->clock };
    return true;
}

bool srv_measures_remove(struct srv_measures *measures, const char *id) {
    struct srv_measure_item *item = srv_measures_find(measures, id);
    if (!item)
        return false;
    const size_t behind = (size_t)(measures->items + measures->count - item) - 1;
    memmove(item, item + 1, behind * sizeof *item);
    measures->count--;
    measures->clock++;
    return true;
}

bool srv_measures_copy(const struct srv_measures *measures, struct srv_measures *copy) {
    *copy = (struct srv_measures){ .clock = measures->clock };
    if (measures->count == 0)
        return true;
    copy->items = malloc(measures->count * sizeof *copy->items);
    if (!copy->items)
        return false;
    copy->count = copy->capacity = measures->count;
    memcpy(copy->items, measures->items, measures->count * sizeof *copy->items);
    return true;
}

void srv_measures_finish(struct srv_measures *measures) {
    free(measures->items);
    *measures = (struct srv_measures){ .items = NULL };
}

proto_json *srv_measures_encode(const struct srv_measures *measures) {
    proto_json *array = proto_json_array();
    for (size_t i = 0; i < measures->count; i++)
        proto_json_append(&array, proto_measure_encode(&measures->items[i].measure));
    return array;
}

bool srv_measures_restore(struct srv_measures *measures, const proto_json *array) {
    struct proto_measure measure;
    struct sp_error err;
    for (size_t i = 0; i < proto_json_size(array) && i < SRV_MEASURES_MAX; i++)
        if (proto_measure_restore(proto_json_at(array, i), &measure) &&
            !srv_measures_put(measures, &measure, &err))
            return false;
    return true;
}
