/* SPDX-License-Identifier: Apache-2.0 */
#include "backend/gl/program.h"

#include <assert.h>
#include <epoxy/gl.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

#include "sp/log.h"

enum { SOURCES_MAX = 14 };

/* Writes the driver's whole log to the program's log and its first line to the error. Frees it. */
static bool fail_with_log(const char *name, const char *what, char *text, struct sp_error *err) {
    sp_log(SP_LOG_ERROR, "shader %s does not %s:", name, what);
    char *save = NULL, first[SP_ERROR_TEXT / 2] = "no log";
    char *line = text ? strtok_r(text, "\n", &save) : NULL;
    if (line)
        snprintf(first, sizeof first, "%s", line);
    for (; line; line = strtok_r(NULL, "\n", &save))
        sp_log(SP_LOG_ERROR, "%s", line);
    free(text);
    return sp_fail(err, SP_ERR_BACKEND, "", "shader %s does not %s: %s", name, what, first);
}

static bool compile(unsigned shader, const char *name, const char *defines,
                    const char *const *sources, struct sp_error *err) {
    char preamble[256];
    const char *texts[SOURCES_MAX] = { preamble, defines };
    int count = 2, ok = 0, length = 0;
    snprintf(preamble, sizeof preamble,
             "#version 430 core\n#define TILE %d\n#define GROUP %d\n#define SCAN_BLOCK %d\n"
             "#define TABLE_SCALES %d\n#define PARTS %d\n#define CLIP_PLANES %d\n"
             "#define LIGHTS %d\n",
             GL_TILE, GL_GROUP, GL_SCAN_BLOCK, GL_TABLE_SCALES, GL_PARTS, GL_CLIP_PLANES,
             GL_LIGHTS);
    for (; sources[count - 2]; count++) {
        assert(count < SOURCES_MAX);
        texts[count] = sources[count - 2];
    }
    glShaderSource(shader, count, texts, NULL);
    glCompileShader(shader);
    glGetShaderiv(shader, GL_COMPILE_STATUS, &ok);
    if (ok)
        return true;
    glGetShaderiv(shader, GL_INFO_LOG_LENGTH, &length);
    char *text = length > 0 ? calloc((size_t)length + 1, 1) : NULL;
    if (text)
        glGetShaderInfoLog(shader, length, NULL, text);
    return fail_with_log(name, "compile", text, err);
}

static bool link_program(unsigned program, unsigned shader, const char *name,
                         struct sp_error *err) {
    int ok = 0, length = 0;
    glAttachShader(program, shader);
    glLinkProgram(program);
    glDetachShader(program, shader);
    glGetProgramiv(program, GL_LINK_STATUS, &ok);
    if (ok)
        return true;
    glGetProgramiv(program, GL_INFO_LOG_LENGTH, &length);
    char *text = length > 0 ? calloc((size_t)length + 1, 1) : NULL;
    if (text)
        glGetProgramInfoLog(program, length, NULL, text);
    return fail_with_log(name, "link", text, err);
}

unsigned gl_program_create(const char *name, const char *defines, const char *const *sources,
                           struct sp_error *err) {
    unsigned shader = glCreateShader(GL_COMPUTE_SHADER), program = glCreateProgram();
    bool ok = shader && program;
    if (!ok)
        sp_fail(err, SP_ERR_BACKEND, "", "shader %s: glCreateShader or glCreateProgram failed",
                name);
    ok = ok && compile(shader, name, defines, sources, err) &&
         link_program(program, shader, name, err);
    glDeleteShader(shader);
    if (!ok)
        glDeleteProgram(program);
    return ok ? program : 0;
}

static const char *find_source(const char *name, size_t length) {
    for (const struct gl_source *s = gl_sources; s->name; s++)
        if (strlen(s->name) == length && strncmp(s->name, name, length) == 0)
            return s->text;
    return NULL;
}

unsigned gl_program_open(const char *names, const char *defines, struct sp_error *err) {
    const char *texts[SOURCES_MAX] = { NULL }, *last = names;
    int count = 0;
    for (const char *at = names; *at; at += strspn(at, " ")) {
        size_t length = strcspn(at, " ");
        last = at;
        assert(count + 1 < SOURCES_MAX);
        texts[count++] = find_source(at, length);
        assert(texts[count - 1]);
        at += length;
    }
    return gl_program_create(last, defines, texts, err);
}

bool gl_program_late(struct gl_late_program *own, const char *names, const char *defines,
                     const char *device, const char *what, struct sp_error *err) {
    struct sp_error why = { .text = "it failed before; the log has the reason" };
    if (!own->program && !own->is_refused)
        own->program = gl_program_open(names, defines, &why);
    own->is_refused = !own->program;
    return own->program || sp_fail(err, SP_ERR_UNSUPPORTED, "", "%s has no program for %s: %s",
                                   device, what, why.text);
}
