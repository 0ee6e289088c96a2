# SPDX-License-Identifier: Apache-2.0
# srv_embed(TARGET ENTRY...): adds a source file that holds files as bytes, and their table
# srv_assets (assets.h). An entry is URL-PATH=FILE. The assembler's .incbin reads the files, so that
# they need no conversion; the object depends on them.
function(srv_mime out file)
    get_filename_component(extension ${file} LAST_EXT)
    set(mime_.html "text/html; charset=utf-8")
    set(mime_.css "text/css; charset=utf-8")
    set(mime_.js "text/javascript; charset=utf-8")
    set(mime_.svg "image/svg+xml")
    set(mime_.png "image/png")
    set(mime_.ico "image/x-icon")
    set(mime_.json "application/json")
    set(mime_.md "text/markdown; charset=utf-8")
    set(mime_.yaml "application/yaml")
    set(mime_.woff2 "font/woff2")
    if(NOT DEFINED mime_${extension})
        message(FATAL_ERROR "${file}: no media type is known for ${extension}; add it to server/http/embed.cmake")
    endif()
    set(${out} "${mime_${extension}}" PARENT_SCOPE)
endfunction()

function(srv_embed target)
    set(assembler "")
    set(declarations "")
    set(rows "")
    set(files "")
    set(i 0)
    foreach(entry IN LISTS ARGN)
        string(FIND ${entry} "=" at)
        string(SUBSTRING ${entry} 0 ${at} path)
        math(EXPR after "${at} + 1")
        string(SUBSTRING ${entry} ${after} -1 file)
        srv_mime(mime ${file})
        string(APPEND assembler
            "    \".balign 16\\nsrv_asset_${i}_begin:\\n.incbin \\\"${file}\\\"\\n\"\n"
            "    \"srv_asset_${i}_end:\\n.byte 0\\n\"\n")
        string(APPEND declarations
            "extern const unsigned char srv_asset_${i}_begin[], srv_asset_${i}_end[];\n")
        string(APPEND rows "    { \"${path}\", \"${mime}\", srv_asset_${i}_begin, srv_asset_${i}_end },\n")
        list(APPEND files ${file})
        math(EXPR i "${i} + 1")
    endforeach()
    set(source ${CMAKE_CURRENT_BINARY_DIR}/${target}_assets.c)
    file(CONFIGURE OUTPUT ${source} @ONLY CONTENT
"/* SPDX-License-Identifier: Apache-2.0 */
/* Made by server/http/embed.cmake. */
#include \"http/assets.h\"

__asm__(
    \".pushsection .rodata\\n\"
@assembler@    \".popsection\\n\");
@declarations@
const struct srv_asset srv_assets[] = {
@rows@};
const size_t srv_asset_count = @i@;
")
    set_source_files_properties(${source} PROPERTIES OBJECT_DEPENDS "${files}")
    target_sources(${target} PRIVATE ${source})
endfunction()
