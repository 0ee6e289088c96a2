# SPDX-License-Identifier: Apache-2.0
# `cmake --install BUILD --prefix PREFIX` installs
#   lib/splatd/                          splat-import, and modules that are loaded on demand (base/locate.h)
# and of the component dev, libsplat for other programs:
#   lib/libsplat.so, lib/libsplat.a      the library; only functions marked SP_API are exported
#   include/sp/                          the public headers
#   lib/pkgconfig/splat.pc               for pkg-config
#   lib/cmake/splat/                     for find_package(splat): targets splat::splat and splat::splat_static
# clients/example/ uses it, and tests/install/ checks it.
include(CMakePackageConfigHelpers)

# Libraries that the static library needs, as pkg-config names and as targets.
set(packages libturbojpeg libpng libwebp libzstd vpx zlib)
set(targets PkgConfig::TURBOJPEG PkgConfig::PNG PkgConfig::WEBP PkgConfig::ZSTD PkgConfig::VPX PkgConfig::GZIP)
if(TARGET PkgConfig::EPOXY)
    list(APPEND packages epoxy)
    list(APPEND targets PkgConfig::EPOXY)
endif()

# Of the same objects as the static library. Sanitized builds test the static one alone.
if(SPLATD_SHARED AND NOT SPLATD_SANITIZE AND NOT SPLATD_FUZZ)
    add_library(splat_shared SHARED $<TARGET_OBJECTS:splat>)
    foreach(isa ${SPLAT_ISAS})
        target_sources(splat_shared PRIVATE $<TARGET_OBJECTS:splat_kernels_${isa}>)
    endforeach()
    set_target_properties(splat_shared PROPERTIES LINKER_LANGUAGE C OUTPUT_NAME splat EXPORT_NAME splat VERSION ${PROJECT_VERSION}
        SOVERSION ${PROJECT_VERSION_MAJOR}.${PROJECT_VERSION_MINOR} LIBRARY_OUTPUT_DIRECTORY ${CMAKE_CURRENT_BINARY_DIR})
    target_include_directories(splat_shared INTERFACE $<INSTALL_INTERFACE:${CMAKE_INSTALL_INCLUDEDIR}>)
    target_link_libraries(splat_shared PRIVATE ${targets} Threads::Threads m ${CMAKE_DL_LIBS})
    target_link_options(splat_shared PRIVATE LINKER:--no-undefined)
    install(TARGETS splat_shared EXPORT splat LIBRARY DESTINATION ${CMAKE_INSTALL_LIBDIR} COMPONENT dev)
    install(EXPORT splat NAMESPACE splat:: FILE splat-targets.cmake DESTINATION ${CMAKE_INSTALL_LIBDIR}/cmake/splat COMPONENT dev)
endif()

list(JOIN packages " " packages)
configure_file(splat.pc.in splat.pc @ONLY)
configure_package_config_file(splat-config.cmake.in splat-config.cmake INSTALL_DESTINATION ${CMAKE_INSTALL_LIBDIR}/cmake/splat
    PATH_VARS CMAKE_INSTALL_INCLUDEDIR CMAKE_INSTALL_LIBDIR)
write_basic_package_version_file(splat-config-version.cmake COMPATIBILITY SameMinorVersion)

install(TARGETS splat ARCHIVE DESTINATION ${CMAKE_INSTALL_LIBDIR} COMPONENT dev)
install(TARGETS splat-import RUNTIME DESTINATION ${SPLATD_PRIVATE_DIR} COMPONENT runtime)
if(TARGET splat-fetch)
    install(TARGETS splat-fetch RUNTIME DESTINATION ${SPLATD_PRIVATE_DIR} COMPONENT runtime)
endif()
install(TARGETS splat-import-dicom ${SPLATD_OPTIONAL_IMPORTERS} splat-import-image splat-import-mesh splat-import-tiff splat-exr LIBRARY DESTINATION ${SPLATD_PRIVATE_DIR} COMPONENT runtime)
if(TARGET splat-x264)
    install(TARGETS splat-x264 LIBRARY DESTINATION ${SPLATD_PRIVATE_DIR} COMPONENT runtime)
endif()
install(DIRECTORY include/sp DESTINATION ${CMAKE_INSTALL_INCLUDEDIR} COMPONENT dev FILES_MATCHING PATTERN "*.h")
install(FILES ${CMAKE_CURRENT_BINARY_DIR}/splat.pc DESTINATION ${CMAKE_INSTALL_LIBDIR}/pkgconfig COMPONENT dev)
install(FILES ${CMAKE_CURRENT_BINARY_DIR}/splat-config.cmake ${CMAKE_CURRENT_BINARY_DIR}/splat-config-version.cmake
    DESTINATION ${CMAKE_INSTALL_LIBDIR}/cmake/splat COMPONENT dev)
