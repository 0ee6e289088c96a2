# SPDX-License-Identifier: Apache-2.0
# gl_embed(TARGET FILE...): adds a source file that holds shaders as texts, and their table gl_sources (program.h).
# The assembler's .incbin reads the files, so that they need no conversion; the object depends on them.
function(gl_embed target)
    set(assembler "")
    set(declarations "")
    set(rows "")
    set(i 0)
    foreach(file IN LISTS ARGN)
        get_filename_component(name ${file} NAME_WE)
        string(APPEND assembler "    \"gl_source_${i}:\\n.incbin \\\"${file}\\\"\\n.byte 0\\n\"\n")
        string(APPEND declarations "extern const char gl_source_${i}[];\n")
        string(APPEND rows "    { \"${name}\", gl_source_${i} },\n")
        math(EXPR i "${i} + 1")
    endforeach()
    set(source ${CMAKE_CURRENT_BINARY_DIR}/gl_sources.c)
    file(CONFIGURE OUTPUT ${source} @ONLY CONTENT
"/* SPDX-License-Identifier: Apache-2.0 */
/* Made by renderer/backend/gl/embed.cmake. */
#include \"backend/gl/program.h\"

#include <stddef.h>

__asm__(
    \".pushsection .rodata\\n\"
@assembler@    \".popsection\\n\");
@declarations@
const struct gl_source gl_sources[] = {
@rows@    { NULL, NULL },
};
")
    set_source_files_properties(${source} TARGET_DIRECTORY ${target} PROPERTIES OBJECT_DEPENDS "${ARGN}")
    target_sources(${target} PRIVATE ${source})
endfunction()
