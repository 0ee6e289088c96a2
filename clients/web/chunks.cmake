# SPDX-License-Identifier: Apache-2.0
# cmake -DFOLDER=… -DPARTS=… -P chunks.cmake: gives the two chunks that esbuild makes the names of CMakeLists.txt. esbuild names them by their
# contents; the daemon's table of files needs names that stay. shared.js is the chunk that the element loads, page.js the other one. The page
# and its parts get the same mark of their build, by which the page refuses parts of another build (app/shell/part.js).
file(GLOB chunks RELATIVE ${FOLDER}/app/chunks ${FOLDER}/app/chunks/chunk-*.js)
list(LENGTH chunks count)
if(NOT count EQUAL 2)
    message(FATAL_ERROR "esbuild made ${count} chunks instead of 2 (${chunks}): each of app/parts/ imports app/main.js, and no two of them what the page does not import")
endif()
file(READ ${FOLDER}/element/splat-view.js element)
foreach(chunk IN LISTS chunks)
    string(FIND "${element}" "${chunk}" at)
    if(at LESS 0)
        set(page ${chunk})
    else()
        set(shared ${chunk})
    endif()
endforeach()
string(SHA256 build "${page} ${shared}") # both names are hashes
string(SUBSTRING ${build} 0 12 build)
foreach(file app/main.js ${PARTS} element/splat-view.js app/chunks/${page} app/chunks/${shared})
    file(READ ${FOLDER}/${file} text)
    string(REPLACE "${page}" "page.js" text "${text}")
    string(REPLACE "${shared}" "shared.js" text "${text}")
    string(REPLACE "BUILD_OF_THE_PAGE" "${build}" text "${text}")
    file(WRITE ${FOLDER}/${file} "${text}")
endforeach()
file(RENAME ${FOLDER}/app/chunks/${page} ${FOLDER}/app/chunks/page.js)
file(RENAME ${FOLDER}/app/chunks/${shared} ${FOLDER}/app/chunks/shared.js)
