/* SPDX-License-Identifier: Apache-2.0 */
#include "backend/gl/egl.h"

#include <dlfcn.h>
#include <errno.h>
#include <stdio.h>
#include <string.h>
#include <unistd.h>

bool gl_egl_fail(struct sp_error *err, const char *call) {
    static const char *const names[] = {
        "EGL_SUCCESS",       "EGL_NOT_INITIALIZED",     "EGL_BAD_ACCESS",
        "EGL_BAD_ALLOC",     "EGL_BAD_ATTRIBUTE",       "EGL_BAD_CONFIG",
        "EGL_BAD_CONTEXT",   "EGL_BAD_CURRENT_SURFACE", "EGL_BAD_DISPLAY",
        "EGL_BAD_MATCH",     "EGL_BAD_NATIVE_PIXMAP",   "EGL_BAD_NATIVE_WINDOW",
        "EGL_BAD_PARAMETER", "EGL_BAD_SURFACE",         "EGL_CONTEXT_LOST",
    };
    unsigned code = (unsigned)eglGetError() - EGL_SUCCESS;
    if (code < sizeof names / sizeof names[0])
        return sp_fail(err, SP_ERR_BACKEND, "", "%s failed: %s", call, names[code]);
    return sp_fail(err, SP_ERR_BACKEND, "", "%s failed: EGL error 0x%x", call, code + EGL_SUCCESS);
}

/* libepoxy loads the libraries at its first call and ends the process if that fails. Therefore they
 * are loaded here first, under the same names, and stay loaded. */
static bool load_libraries(struct sp_error *err) {
    static const char *const choices[][2] = { { "libEGL.so.1", "libEGL.so.1" },
                                              { "libOpenGL.so.0", "libGL.so.1" } };
    for (int i = 0; i < 2; i++) {
        void *library = NULL;
        for (int k = 0; k < 2 && !library; k++)
            library = dlopen(choices[i][k], RTLD_LAZY | RTLD_LOCAL | RTLD_NODELETE);
        if (!library)
            return sp_fail(err, SP_ERR_BACKEND, "", "%s cannot be loaded: %s", choices[i][1],
                           dlerror());
        dlclose(library);
    }
    return true;
}

/* True if the name is in a list of extensions, separated by spaces. A NULL list is empty. */
static bool has_extension(const char *list, const char *name) {
    size_t length = strlen(name);
    while (list && (list = strstr(list, name))) {
        if (list[length] == ' ' || list[length] == 0)
            return true;
        list += length;
    }
    return false;
}

#ifndef EGL_DRM_RENDER_NODE_FILE_EXT /* newer than the header of Debian 12 */
#define EGL_DRM_RENDER_NODE_FILE_EXT 0x3377
#endif

static struct gl_place device_place(unsigned i, EGLDeviceEXT device) {
    static const struct {
        const char *extension;
        EGLint name;
    } files[] = { { "EGL_EXT_device_drm_render_node", EGL_DRM_RENDER_NODE_FILE_EXT },
                  { "EGL_EXT_device_drm", EGL_DRM_DEVICE_FILE_EXT } };
    struct gl_place place = { .platform = GL_PLATFORM_DEVICE, .gpu = (int)i, .device = device };
    const char *extensions = eglQueryDeviceStringEXT(device, EGL_EXTENSIONS), *file = NULL;
    for (int k = 0; k < 2 && !file; k++)
        if (has_extension(extensions, files[k].extension))
            file = eglQueryDeviceStringEXT(device, files[k].name);
    place.is_software = has_extension(extensions, "EGL_MESA_device_software");
    snprintf(place.file, sizeof place.file, "%s", file ? file : "");
    return place;
}

static void add(struct gl_places *places, enum gl_platform platform, const char *missing,
                bool is_software) {
    places->list[places->count++] = (struct gl_place){
        .platform = platform, .gpu = -1, .missing = missing, .is_software = is_software
    };
}

/* Returns the first of the extensions that EGL lacks; NULL = none is missing. The list of a driver
 * loader without drivers is empty. */
static const char *missing_of(const char *client, const char *const *extensions) {
    if (client && !*client)
        return "a driver";
    while (*extensions && has_extension(client, *extensions))
        extensions++;
    return *extensions;
}

static void list_devices(struct gl_places *places, const char *client) {
    static const char *const wanted[] = { "EGL_EXT_platform_base", "EGL_EXT_platform_device",
                                          "EGL_EXT_device_enumeration", "EGL_EXT_device_query",
                                          NULL };
    static const char *const wanted_with_base[] = { "EGL_EXT_platform_base",
                                                    "EGL_EXT_platform_device", NULL };
    EGLDeviceEXT devices[GL_DEVICES_MAX];
    EGLint count = 0;
    /* EGL_EXT_device_base combines the last two; NVIDIA drivers list it alone. */
    bool has_base = has_extension(client, "EGL_EXT_device_base");
    const char *missing = missing_of(client, has_base ? wanted_with_base : wanted);
    if (!missing && !eglQueryDevicesEXT(GL_DEVICES_MAX, devices, &count))
        count = 0;
    for (; places->devices < (unsigned)count; places->devices++)
        places->list[places->count++] = device_place(places->devices, devices[places->devices]);
    if (count == 0)
        add(places, GL_PLATFORM_DEVICE, missing ? missing : "any device", false);
}

bool gl_places_list(struct gl_places *places, struct sp_error *err) {
    static const char *const surfaceless[] = { "EGL_EXT_platform_base",
                                               "EGL_MESA_platform_surfaceless", NULL };
    *places = (struct gl_places){ .count = 0 };
    if (!load_libraries(err))
        return false;
    const char *client = eglQueryString(EGL_NO_DISPLAY, EGL_EXTENSIONS);
    list_devices(places, client);
    bool is_software = places->devices > 0;
    for (unsigned i = 0; i < places->devices; i++)
        is_software = is_software && places->list[i].is_software;
    add(places, GL_PLATFORM_SURFACELESS, missing_of(client, surfaceless), is_software);
    add(places, GL_PLATFORM_DEFAULT, NULL, is_software);
    return true;
}

void gl_place_name(const struct gl_place *place, char *text, size_t size) {
    static const char *const names[] = { [GL_PLATFORM_DEVICE] = "device",
                                         [GL_PLATFORM_SURFACELESS] = "surfaceless",
                                         [GL_PLATFORM_DEFAULT] = "default" };
    if (place->gpu < 0)
        snprintf(text, size, "%s display", names[place->platform]);
    else
        snprintf(text, size, "EGL device %d%s%s%s", place->gpu, place->file[0] ? " (" : "",
                 place->file, place->file[0] ? ")" : "");
}

void gl_place_add_cause(const struct gl_place *place, struct sp_error *why) {
    if (!place->file[0] || access(place->file, R_OK | W_OK) == 0)
        return;
    const char *cause = strerror(errno);
    size_t used = strlen(why->text);
    snprintf(why->text + used, sizeof why->text - used, "; %s cannot be opened: %s", place->file,
             cause);
}

EGLDisplay gl_place_open(const struct gl_place *place, struct sp_error *err) {
    EGLDisplay display;
    if (place->missing) {
        sp_fail(err, SP_ERR_BACKEND, "", "EGL does not have %s", place->missing);
        return EGL_NO_DISPLAY;
    }
    if (place->gpu >= 0)
        display = eglGetPlatformDisplayEXT(EGL_PLATFORM_DEVICE_EXT, place->device, NULL);
    else if (place->platform == GL_PLATFORM_SURFACELESS)
        display =
            eglGetPlatformDisplayEXT(EGL_PLATFORM_SURFACELESS_MESA, EGL_DEFAULT_DISPLAY, NULL);
    else
        display = eglGetDisplay(EGL_DEFAULT_DISPLAY);
    if (display == EGL_NO_DISPLAY)
        gl_egl_fail(err, "eglGetDisplay");
    else if (!eglInitialize(display, NULL, NULL)) {
        gl_egl_fail(err, "eglInitialize");
        display = EGL_NO_DISPLAY;
    }
    return display;
}
