/* SPDX-License-Identifier: Apache-2.0
 *
 * Compute programs, one a stage. The sources in shaders/ are embedded when the backend is built; a
 * program is a few of them joined behind one preamble of constants that the C side shares:
 *
 *   #version 430 core, #define TILE …  +  what stages share  +  NN_stage.glsl
 */
#ifndef GL_PROGRAM_H
#define GL_PROGRAM_H

#include "sp/status.h"

/* What shaders and the C side must agree on; gl_program_create() defines them by these names. */
enum {
    GL_TILE = 8,           /* px, both ways: one work group of the compositor */
    GL_GROUP = 256,        /* threads of the other work groups */
    GL_SCAN_BLOCK = 1024,  /* bins that one group sums: GL_GROUP · 4 */
    GL_TABLE_SCALES = 256, /* vec4 in front of a list's tables: see list.h */
    GL_PARTS = 16,         /* levels, each as it is and enlarged */
    GL_CLIP_PLANES = 14,   /* clipping planes */
    GL_LIGHTS = 8
};

/* A source, by the name of its file. `text` ends with NUL. */
struct gl_source {
    const char *name, *text;
};

/* In the order of their names; NULL name at the end. Made by embed.cmake. */
extern const struct gl_source gl_sources[];

/* Compiles and links. `name` stands in errors; `defines`: lines "#define …\n" of the program's own,
 * "" = none; `sources`: texts, NULL at the end. Returns the
 * program's name in GL, or 0 with SP_ERR_BACKEND set: the whole log is logged as errors, line by
 * line, and the error holds the stage and the log's first line. A context must be current. */
unsigned gl_program_create(const char *name, const char *defines, const char *const *sources,
                           struct sp_error *err);

/* The same of embedded sources by name, space-separated, the last of which names the program. */
unsigned gl_program_open(const char *names, const char *defines, struct sp_error *err);

#endif
