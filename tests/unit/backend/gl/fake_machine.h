/* SPDX-License-Identifier: Apache-2.0
 *
 * A machine with GPUs that needs none: EGL and GL are played, in the place of the functions that
 * libepoxy found.
 */
#ifndef TEST_FAKE_MACHINE_H
#define TEST_FAKE_MACHINE_H

#include "backend/gl/egl.h"

#include <epoxy/gl.h>

/* One display and the GL behind it. */
struct driver {
    bool broken;        /* does not initialise */
    EGLint error;       /* of its last call that failed; 0 = EGL_NOT_INITIALIZED */
    const char *name;   /* GL_RENDERER */
    int minor;          /* gives core contexts of OpenGL 4.0 to 4.minor; −1 = no core context */
    bool no_resets;     /* gives none that tells of resets */
    bool no_desktop;    /* gives no context of desktop GL at all */
    bool wants_surface; /* has not the extensions to do without */
    bool is_known_software; /* the device says so */
    const char *file;       /* the device's node */
    int video_mib;          /* by GL_NVX_gpu_memory_info; 0 = does not tell */
    bool compiles_nothing;
    bool lacks_memory; /* for buffers */
    bool is_refused;   /* by whoever starts on it, once all is there */
};

enum { DEVICES = 4, SURFACELESS = DEVICES, DEFAULT, DRIVERS };
extern struct driver drivers[DRIVERS];
extern unsigned device_count;
extern const char *client_extensions;
extern const char all_extensions[];

enum { NAMES = 1 << 16 };

struct machine { /* what is there now */
    EGLint error;
    struct driver *current;
    int contexts, surfaces;
    bool is_live[NAMES]; /* programs and buffers; as in GL, what is deleted twice is ignored */
    GLenum gl_error;
    GLuint names;   /* given out so far */
    unsigned asked; /* bit n = driver n: whether it will do */
    int minor;      /* of the newest context */
    bool tells_reset;
    unsigned initialised; /* bit n = driver n */
};
extern struct machine machine;

void play_the_machine(void);

/* For cmocka: one good GPU before each test; nothing is left behind after it, whatever happened. */
int machine_begin(void **state);
int machine_end(void **state);

#endif
