# SPDX-License-Identifier: Apache-2.0
# The Debian package of the component runtime. `deploy/package.sh` builds it, with the compiler flags of Debian.
install(FILES ${made}/changelog.Debian.gz DESTINATION ${documents} COMPONENT debian EXCLUDE_FROM_ALL)
add_custom_target(splatd_debian DEPENDS ${made}/changelog.Debian.gz)

set(CPACK_GENERATOR DEB)
set(CPACK_INSTALL_CMAKE_PROJECTS "${PROJECT_BINARY_DIR};splatd;runtime;/;${PROJECT_BINARY_DIR};splatd;debian;/")
set(CPACK_PACKAGE_NAME splatd)
set(CPACK_PACKAGE_VERSION ${PROJECT_VERSION})
set(CPACK_PACKAGE_CONTACT "splatd maintainers <maintainers@splatd.invalid>")
set(CPACK_PACKAGE_DESCRIPTION_SUMMARY "volume rendering in the browser")
set(CPACK_DEBIAN_PACKAGE_DESCRIPTION
"splatd loads a volume once, renders it by EWA splatting next to the data, and
streams the images to browsers and scripts over HTTP and WebSocket. Users need
only a browser and no graphics card; the daemon uses a GPU if there is one.
It reads NRRD, DICOM, NIfTI, VTK, OME-Zarr, HDF5, TIFF and other formats in a
process without rights.
.
This package has the daemon with its service, and splatctl for scripts.")
set(CPACK_STRIP_FILES ON)
# The configuration lies outside of the prefix.
set(CPACK_SET_DESTDIR ON)
set(CPACK_INSTALL_PREFIX /usr)
set(CPACK_PACKAGING_INSTALL_PREFIX /usr)
set(CPACK_DEBIAN_FILE_NAME DEB-DEFAULT)
set(CPACK_DEBIAN_PACKAGE_RELEASE 1)
set(CPACK_DEBIAN_PACKAGE_SECTION science)
set(CPACK_DEBIAN_PACKAGE_SHLIBDEPS ON)
set(CPACK_DEBIAN_PACKAGE_DEPENDS adduser)
set(CPACK_DEBIAN_PACKAGE_RECOMMENDS "ca-certificates, libegl1, libgl1-mesa-dri")
set(CPACK_DEBIAN_PACKAGE_CONTROL_STRICT_PERMISSION ON)
set(CPACK_DEBIAN_PACKAGE_CONTROL_EXTRA)
foreach(file conffiles postinst prerm postrm)
    list(APPEND CPACK_DEBIAN_PACKAGE_CONTROL_EXTRA ${CMAKE_CURRENT_SOURCE_DIR}/package/debian/${file})
endforeach()
include(CPack)
