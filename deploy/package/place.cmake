# SPDX-License-Identifier: Apache-2.0
# Part of `cmake --install`: the files that depend on the prefix. CMakeLists.txt sets source, made, bin and share.
if(CMAKE_INSTALL_PREFIX STREQUAL "/usr")
    set(etc /etc)
else()
    set(etc ${CMAKE_INSTALL_PREFIX}/etc)
endif()

file(READ ${source}/splatd.service unit)
string(REPLACE "/usr/bin/" "${CMAKE_INSTALL_PREFIX}/${bin}/" unit "${unit}")
string(REPLACE "/etc/splatd" "${etc}/splatd" unit "${unit}")
file(WRITE ${made}/splatd.service "${unit}")
file(INSTALL ${made}/splatd.service DESTINATION ${CMAKE_INSTALL_PREFIX}/lib/systemd/system)

# An administrator may have changed the configuration.
if(EXISTS "$ENV{DESTDIR}${etc}/splatd/splatd.conf")
    message(STATUS "Kept: $ENV{DESTDIR}${etc}/splatd/splatd.conf")
else()
    file(INSTALL ${source}/package/splatd.conf DESTINATION ${etc}/splatd)
endif()

# Debian's zsh searches another folder for packages than for programs that were built on the machine.
if(CMAKE_INSTALL_PREFIX STREQUAL "/usr" AND EXISTS /etc/debian_version)
    set(zsh vendor-completions)
else()
    set(zsh site-functions)
endif()
file(INSTALL ${made}/zsh/_splatd ${made}/zsh/_splatctl DESTINATION ${CMAKE_INSTALL_PREFIX}/${share}/zsh/${zsh})
