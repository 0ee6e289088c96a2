/* SPDX-License-Identifier: Apache-2.0
 *
 * A fake machine with GPUs. It replaces the EGL and GL functions that libepoxy found.
 */
#ifndef TEST_FAKE_MACHINE_H
#define TEST_FAKE_MACHINE_H

#include "backend/gl/egl.h"

#include <epoxy/gl.h>

/* One display and its GL driver. */
struct driver {
    bool broken;        /* eglInitialize fails */
    EGLint error;       /* EGL error of the last call that failed; 0 = EGL_NOT_INITIALIZED */
    const char *name;   /* GL_RENDERER */
    int minor;          /* gives core contexts of OpenGL 4.0 to 4.minor; −1 = no core context */
    bool no_resets;     /* has no contexts that report resets */
    bool no_desktop;    /* has no context of desktop GL */
    bool wants_surface; /* lacks the extensions for contexts without a surface */
    bool is_known_software; /* the device has the software extension */
    const char *file;       /* path of the device node */
    int video_mib;          /* from GL_NVX_gpu_memory_info; 0 = unknown */
    bool compiles_nothing;
    bool lacks_memory; /* allocations of buffers fail */
    bool is_refused;   /* the startup check finds wrong images */
};

enum { DEVICES = 4, SURFACELESS = DEVICES, DEFAULT, DRIVERS };
extern struct driver drivers[DRIVERS];
extern unsigned device_count;
extern const char *client_extensions;
extern const char all_extensions[];

enum { NAMES = 1 << 16 };

struct machine { /* the objects that exist now */
    EGLint error;
    struct driver *current;
    int contexts, surfaces;
    bool is_live[NAMES]; /* programs and buffers; as in GL, deleting one twice is ignored */
    GLenum gl_error;
    GLuint names;   /* names given out so far */
    unsigned asked; /* bit n: the startup check ran on driver n */
    int minor;      /* of the newest context */
    bool tells_reset;
    unsigned initialised; /* bit n: eglInitialize was called on driver n */
};
extern struct machine machine;

void play_the_machine(void);

/* For cmocka: each test starts with one working GPU. The tear-down fails if objects are left. */
int machine_begin(void **state);
int machine_end(void **state);

#endif
