/* SPDX-License-Identifier: Apache-2.0
 *
 * A budget of the memory that frames take: what renderers draw in, pixels, what encoders need.
 * Callers acquire bytes before they allocate them, and release them when they free them. What is
 * cached of volumes has limits of its own (sp_renderer_options.memory_bytes). All functions are
 * thread-safe and accept a NULL budget, which has no limit and counts nothing.
 */
#ifndef SP_BUDGET_H
#define SP_BUDGET_H

#include <stdbool.h>
#include <stdint.h>

#include "sp/api.h"
#include "sp/status.h"

#ifdef __cplusplus
extern "C" {
#endif

enum sp_budget_kind {
    SP_BUDGET_ARENAS,   /* what renderers draw in: records, tiles, fragments */
    SP_BUDGET_IMAGES,   /* pixels of frames */
    SP_BUDGET_ENCODERS, /* of images and of video */
    SP_BUDGET_ANSWERS,  /* encoded images that clients have not read yet, or that are cached */
    SP_BUDGET_KINDS
};

struct sp_budget; /* opaque */

/* limit_bytes: > 0. Returns NULL on failure: SP_ERR_MEMORY. */
SP_API struct sp_budget *sp_budget_create(uint64_t limit_bytes, struct sp_error *err);
/* Accepts a NULL budget and nulls *budget. All bytes must have been released. */
SP_API void sp_budget_destroy(struct sp_budget **budget);

/* Counts the bytes; false, and counts nothing, if that would exceed the limit. */
SP_API bool sp_budget_acquire(struct sp_budget *budget, enum sp_budget_kind kind, uint64_t bytes);
/* Counts bytes that are there already, even above the limit. */
SP_API void sp_budget_add(struct sp_budget *budget, enum sp_budget_kind kind, uint64_t bytes);
SP_API void sp_budget_release(struct sp_budget *budget, enum sp_budget_kind kind, uint64_t bytes);

/* Returns the bytes that are acquired, of one kind or of all. */
SP_API uint64_t sp_budget_used(const struct sp_budget *budget, enum sp_budget_kind kind);
SP_API uint64_t sp_budget_total(const struct sp_budget *budget);
/* UINT64_MAX without a budget. */
SP_API uint64_t sp_budget_limit(const struct sp_budget *budget);

/* Fails with SP_ERR_FRAME_BUDGET and both numbers; returns false. needed: the bytes that the caller
 * could not acquire; what: for the message. */
SP_API bool sp_budget_fail(const struct sp_budget *budget, const char *what, uint64_t needed,
                           struct sp_error *err);

#ifdef __cplusplus
}
#endif

#endif
