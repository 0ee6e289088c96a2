/* SPDX-License-Identifier: Apache-2.0
 *
 * A budget for the memory of frames: the working memory of renderers, pixels, and encoders. Callers
 * acquire bytes before they allocate them, and release the bytes when they free them. Cached data
 * of volumes has limits of its own (sp_renderer_options.memory_bytes). All functions are
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
    SP_BUDGET_ARENAS,   /* working memory of renderers: records, tiles, fragments */
    SP_BUDGET_IMAGES,   /* pixels of frames */
    SP_BUDGET_ENCODERS, /* encoders of images and of video */
    SP_BUDGET_ANSWERS,  /* encoded images that clients have not read yet, or that are cached */
    SP_BUDGET_KINDS
};

struct sp_budget; /* opaque */

/* limit_bytes: > 0. Returns NULL on failure: SP_ERR_MEMORY. */
SP_API struct sp_budget *sp_budget_create(uint64_t limit_bytes, struct sp_error *err);
/* Accepts a NULL budget and nulls *budget. All bytes must have been released. */
SP_API void sp_budget_destroy(struct sp_budget **budget);

/* Counts the bytes. If they would exceed the limit, counts nothing and returns false. */
SP_API bool sp_budget_acquire(struct sp_budget *budget, enum sp_budget_kind kind, uint64_t bytes);
/* Counts bytes that are already allocated, even above the limit. */
SP_API void sp_budget_add(struct sp_budget *budget, enum sp_budget_kind kind, uint64_t bytes);
SP_API void sp_budget_release(struct sp_budget *budget, enum sp_budget_kind kind, uint64_t bytes);

/* Return the bytes that are acquired now: of one kind, or of all kinds. */
SP_API uint64_t sp_budget_used(const struct sp_budget *budget, enum sp_budget_kind kind);
SP_API uint64_t sp_budget_total(const struct sp_budget *budget);
/* UINT64_MAX without a budget. */
SP_API uint64_t sp_budget_limit(const struct sp_budget *budget);

/* Sets *err to SP_ERR_FRAME_BUDGET, with the needed bytes and the limit in the text; returns false.
 * needed: the bytes that the caller could not acquire. what: names their purpose in the text. */
SP_API bool sp_budget_fail(const struct sp_budget *budget, const char *what, uint64_t needed,
                           struct sp_error *err);

#ifdef __cplusplus
}
#endif

#endif
