/* SPDX-License-Identifier: Apache-2.0 */
#ifndef GL_PLATFORM_H
#define GL_PLATFORM_H

/* The ways in which EGL offers a display. */
enum gl_platform {
    GL_PLATFORM_ANY,
    GL_PLATFORM_DEVICE,
    GL_PLATFORM_SURFACELESS,
    GL_PLATFORM_DEFAULT
};

#endif
