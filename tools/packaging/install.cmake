# What `cmake --install` puts where, as a Debian package has it (GNUInstallDirs), in components: `runtime`
# (programs, configuration, unit, manual), `client` (the C library), `python`, `development` (libraries, headers,
# CMake package). tools/package makes a .deb of each.
set(HERE ${PROJECT_SOURCE_DIR}/tools/packaging)
set(DATA ${CMAKE_INSTALL_DATADIR}/hapticd)
set(HEADERS ${CMAKE_INSTALL_INCLUDEDIR}/hapticd)

# Programs.
install(TARGETS hapticd haptic_tool haptic_device RUNTIME DESTINATION ${CMAKE_INSTALL_BINDIR} COMPONENT runtime)
install(DIRECTORY config/scenes config/devices config/charts config/dds DESTINATION ${DATA} COMPONENT runtime
        USE_SOURCE_PERMISSIONS PATTERN "*.pem" EXCLUDE PATTERN "*.key" EXCLUDE)
install(FILES idl/device.idl idl/edge.idl idl/scene.idl idl/command.idl idl/ros2.idl idl/README.md DESTINATION ${DATA}/idl COMPONENT development)
file(GLOB SCRIPTS CONFIGURE_DEPENDS tools/plot/plot_*.py tools/plot/chart_report.py)
install(FILES ${SCRIPTS} DESTINATION ${DATA}/scripts COMPONENT runtime)
install(DIRECTORY tools/view/page/ DESTINATION ${DATA}/view COMPONENT runtime)
set(DOCUMENTS ${CMAKE_BINARY_DIR}/documents)
install(CODE "execute_process(COMMAND python3 ${HERE}/documents.py ${PROJECT_SOURCE_DIR} ${DOCUMENTS} COMMAND_ERROR_IS_FATAL ANY)"
        COMPONENT runtime)
install(DIRECTORY ${DOCUMENTS}/ DESTINATION ${CMAKE_INSTALL_DATADIR}/doc/hapticd COMPONENT runtime)
# As Debian wants one of each package; what changed is in CHANGELOG.md.
# Who makes the packages says so as for any Debian package: an address, or a name with it in <>.
set(MAINTAINER "hapticd developers <hapticd@localhost>")
if("$ENV{DEBEMAIL}" MATCHES "^[^<>]+<[^<> ]+@[^<> ]+>$")
  set(MAINTAINER "$ENV{DEBEMAIL}")
elseif(DEFINED ENV{DEBEMAIL})
  set(MAINTAINER "hapticd developers <$ENV{DEBEMAIL}>")
endif()
string(TIMESTAMP NOW "%a, %d %b %Y %H:%M:%S +0000" UTC)
file(WRITE ${CMAKE_BINARY_DIR}/debian_changelog "hapticd (${PROJECT_VERSION}) unstable; urgency=medium

  * See CHANGELOG.md in /usr/share/doc/hapticd.

 -- ${MAINTAINER}  ${NOW}
")
execute_process(COMMAND gzip -9nc ${CMAKE_BINARY_DIR}/debian_changelog OUTPUT_FILE ${CMAKE_BINARY_DIR}/changelog.gz
                COMMAND_ERROR_IS_FATAL ANY)
foreach(pair runtime:hapticd client:libhaptic-client0 python:python3-hapticd development:libhapticd-dev)
  string(REPLACE ":" ";" pair ${pair})
  list(GET pair 0 component)
  list(GET pair 1 package)
  install(FILES ${HERE}/copyright ${CMAKE_BINARY_DIR}/changelog.gz DESTINATION ${CMAKE_INSTALL_DATADIR}/doc/${package}
          COMPONENT ${component})
endforeach()
install(FILES ${HERE}/completion.bash DESTINATION ${CMAKE_INSTALL_DATADIR}/bash-completion/completions
        RENAME haptic COMPONENT runtime)
install(FILES ${HERE}/completion.bash DESTINATION ${CMAKE_INSTALL_DATADIR}/bash-completion/completions
        RENAME hapticd COMPONENT runtime)

# The service. /etc is /etc only below /usr.
if(CMAKE_INSTALL_PREFIX STREQUAL "/usr")
  set(ETC ${CMAKE_INSTALL_FULL_SYSCONFDIR})
else()
  set(ETC ${CMAKE_INSTALL_SYSCONFDIR})
endif()
configure_file(config/service/hapticd.service.in ${CMAKE_BINARY_DIR}/hapticd.service @ONLY)
configure_file(config/service/hapticd.default.in ${CMAKE_BINARY_DIR}/hapticd.default @ONLY)
install(FILES ${CMAKE_BINARY_DIR}/hapticd.service DESTINATION lib/systemd/system COMPONENT runtime)
install(FILES config/service/60-hapticd.rules DESTINATION lib/udev/rules.d COMPONENT runtime)
install(FILES ${CMAKE_BINARY_DIR}/hapticd.default DESTINATION ${ETC}/default RENAME hapticd COMPONENT runtime)

# Manual pages, of what the programs say of themselves.
find_program(HELP2MAN help2man)
if(HELP2MAN)
  set(MAN ${CMAKE_BINARY_DIR}/man)
  file(MAKE_DIRECTORY ${MAN})
  set(NO_INFO --no-info --section=1 --manual=hapticd --source=hapticd)
  add_custom_command(OUTPUT ${MAN}/hapticd.1.gz DEPENDS hapticd ${HERE}/hapticd.h2m
                     COMMAND ${HELP2MAN} ${NO_INFO} --include=${HERE}/hapticd.h2m --output=${MAN}/hapticd.1
                             $<TARGET_FILE:hapticd>
                     COMMAND gzip -9nf ${MAN}/hapticd.1)
  add_custom_command(OUTPUT ${MAN}/haptic.1.gz DEPENDS haptic_tool ${HERE}/haptic.h2m
                     COMMAND ${HELP2MAN} ${NO_INFO} --help-option=--help-all --include=${HERE}/haptic.h2m
                             --output=${MAN}/haptic.1 $<TARGET_FILE:haptic_tool>
                     COMMAND gzip -9nf ${MAN}/haptic.1)
  add_custom_target(man DEPENDS ${MAN}/hapticd.1.gz ${MAN}/haptic.1.gz)
  install(DIRECTORY ${MAN}/ DESTINATION ${CMAKE_INSTALL_MANDIR}/man1 COMPONENT runtime FILES_MATCHING PATTERN "*.1.gz")
endif()

# Libraries: hapticd::physics and hapticd::haptic, and hapticd::driver for devices.
set_target_properties(hapticd_flags PROPERTIES EXPORT_NAME flags)
set_target_properties(haptic_driver PROPERTIES EXPORT_NAME driver)
install(TARGETS hapticd_flags limits idl wire device_file device_client haptic_driver EXPORT hapticdDriverTargets
        ARCHIVE DESTINATION ${CMAKE_INSTALL_LIBDIR}/hapticd COMPONENT development)
install(TARGETS physics haptic EXPORT hapticdTargets
        ARCHIVE DESTINATION ${CMAKE_INSTALL_LIBDIR}/hapticd COMPONENT development)
install(DIRECTORY physics haptic DESTINATION ${HEADERS} COMPONENT development FILES_MATCHING PATTERN "*.h")
install(FILES server/dds/dds.h server/dds/dds_security.h DESTINATION ${HEADERS}/server/dds COMPONENT development)
install(FILES server/os/realtime.h DESTINATION ${HEADERS}/server/os COMPONENT development)
install(FILES tools/driver/driver.h DESTINATION ${HEADERS}/tools/driver COMPONENT development)
install(CODE "execute_process(COMMAND ${CMAKE_COMMAND} -DFROM=${CMAKE_BINARY_DIR}/idl -DTO=${CMAKE_BINARY_DIR}/idl_headers
                              -P ${HERE}/idl_headers.cmake COMMAND_ERROR_IS_FATAL ANY)" COMPONENT development)
install(FILES ${CMAKE_BINARY_DIR}/idl_headers/device.h ${CMAKE_BINARY_DIR}/idl_headers/scene.h
        DESTINATION ${HEADERS}/idl COMPONENT development)
install(FILES tools/driver/example_driver.cpp
        DESTINATION ${CMAKE_INSTALL_DATADIR}/doc/libhapticd-dev/driver COMPONENT development)

# The C library: its package has what runs, the development package the rest.
install(TARGETS haptic_client LIBRARY DESTINATION ${CMAKE_INSTALL_LIBDIR} COMPONENT client
        NAMELINK_COMPONENT development)
set(CLIENT ${PROJECT_SOURCE_DIR}/tools/client_library)
configure_file(${CLIENT}/haptic_client.pc.in ${CMAKE_BINARY_DIR}/haptic_client.pc @ONLY)
install(FILES ${CLIENT}/haptic_client.h DESTINATION ${CMAKE_INSTALL_INCLUDEDIR} COMPONENT development)
install(FILES ${CLIENT}/feel.h DESTINATION ${HEADERS}/tools/client_library COMPONENT development)
install(FILES ${CMAKE_BINARY_DIR}/haptic_client.pc DESTINATION ${CMAKE_INSTALL_LIBDIR}/pkgconfig COMPONENT development)
execute_process(COMMAND gzip -9nc ${CLIENT}/haptic_client.3 OUTPUT_FILE ${CMAKE_BINARY_DIR}/haptic_client.3.gz
                COMMAND_ERROR_IS_FATAL ANY)
install(FILES ${CMAKE_BINARY_DIR}/haptic_client.3.gz DESTINATION ${CMAKE_INSTALL_MANDIR}/man3 COMPONENT development)
install(FILES ${CLIENT}/example.c ${CLIENT}/Press.cs
        DESTINATION ${CMAKE_INSTALL_DATADIR}/doc/libhapticd-dev/client COMPONENT development)

# Python, for Debian's own interpreter.
if(TARGET hapticd_client_module)
  set(PYTHON_PACKAGES lib/python3/dist-packages)
  install(TARGETS hapticd_client_module LIBRARY DESTINATION ${PYTHON_PACKAGES}/hapticd COMPONENT python)
  install(DIRECTORY tools/python/hapticd DESTINATION ${PYTHON_PACKAGES} COMPONENT python FILES_MATCHING PATTERN "*.py")
  install(FILES tools/python/example/press.py
          DESTINATION ${CMAKE_INSTALL_DATADIR}/doc/python3-hapticd COMPONENT python)
endif()

include(CMakePackageConfigHelpers)
set(PACKAGE ${CMAKE_INSTALL_LIBDIR}/cmake/hapticd)
configure_package_config_file(${HERE}/hapticdConfig.cmake.in ${CMAKE_BINARY_DIR}/hapticdConfig.cmake
                              INSTALL_DESTINATION ${PACKAGE})
write_basic_package_version_file(${CMAKE_BINARY_DIR}/hapticdConfigVersion.cmake COMPATIBILITY SameMinorVersion)
install(EXPORT hapticdDriverTargets NAMESPACE hapticd:: DESTINATION ${PACKAGE} COMPONENT development)
install(EXPORT hapticdTargets NAMESPACE hapticd:: DESTINATION ${PACKAGE} COMPONENT development)
install(FILES ${CMAKE_BINARY_DIR}/hapticdConfig.cmake ${CMAKE_BINARY_DIR}/hapticdConfigVersion.cmake
              ${HERE}/FindCHOLMOD.cmake ${HERE}/FindOpenBLAS.cmake
        DESTINATION ${PACKAGE} COMPONENT development)

# Packages.
set(CPACK_GENERATOR DEB)
set(CPACK_PACKAGE_NAME hapticd)
set(CPACK_PACKAGE_VENDOR hapticd)
set(CPACK_PACKAGE_CONTACT "${MAINTAINER}")
set(CPACK_PACKAGING_INSTALL_PREFIX /usr)
set(CPACK_COMPONENTS_ALL runtime client development)
if(TARGET hapticd_client_module)
  list(APPEND CPACK_COMPONENTS_ALL python)
endif()
set(CPACK_STRIP_FILES ON)
set(CPACK_DEB_COMPONENT_INSTALL ON)
set(CPACK_DEBIAN_FILE_NAME DEB-DEFAULT)
set(CPACK_DEBIAN_PACKAGE_CONTROL_STRICT_PERMISSION ON)
set(CPACK_DEBIAN_PACKAGE_PRIORITY optional)
set(CPACK_DEBIAN_RUNTIME_PACKAGE_NAME hapticd)
set(CPACK_DEBIAN_RUNTIME_PACKAGE_SECTION science)
set(CPACK_DEBIAN_RUNTIME_PACKAGE_SHLIBDEPS ON)
set(CPACK_DEBIAN_RUNTIME_PACKAGE_DEPENDS "adduser, python3")  # python3: what makes the scenes' meshes
set(CPACK_DEBIAN_RUNTIME_PACKAGE_RECOMMENDS openssl)
set(CPACK_DEBIAN_RUNTIME_PACKAGE_SUGGESTS "python3-matplotlib, rt-tests, cyclonedds-tools")
set(CPACK_DEBIAN_RUNTIME_PACKAGE_CONTROL_EXTRA "${HERE}/postinst;${HERE}/prerm;${HERE}/postrm;${HERE}/conffiles")
# The profile and the devices' limits are the server's.
set(CPACK_DEBIAN_CLIENT_PACKAGE_NAME libhaptic-client0)
set(CPACK_DEBIAN_CLIENT_PACKAGE_SECTION libs)
set(CPACK_DEBIAN_CLIENT_PACKAGE_SHLIBDEPS ON)
set(CPACK_DEBIAN_PACKAGE_GENERATE_SHLIBS ON)
set(CPACK_DEBIAN_CLIENT_PACKAGE_CONTROL_EXTRA "${HERE}/triggers")
set(CPACK_DEBIAN_CLIENT_PACKAGE_DEPENDS "hapticd (= ${PROJECT_VERSION})")
set(CPACK_DEBIAN_PYTHON_PACKAGE_NAME python3-hapticd)
set(CPACK_DEBIAN_PYTHON_PACKAGE_SECTION python)
set(CPACK_DEBIAN_PYTHON_PACKAGE_SHLIBDEPS ON)
set(CPACK_DEBIAN_PACKAGE_SHLIBDEPS_PRIVATE_DIRS ${CMAKE_BINARY_DIR}/lib)  # libhaptic_client
set(CPACK_DEBIAN_PYTHON_PACKAGE_DEPENDS "libhaptic-client0 (= ${PROJECT_VERSION}), python3 (>= 3.11), python3 (<< 3.12), python3-numpy")
set(CPACK_DEBIAN_PYTHON_PACKAGE_CONTROL_EXTRA "${HERE}/python/prerm")
set(CPACK_DEBIAN_PYTHON_PACKAGE_SUGGESTS python3-matplotlib)
set(CPACK_DEBIAN_DEVELOPMENT_PACKAGE_NAME libhapticd-dev)
set(CPACK_DEBIAN_DEVELOPMENT_PACKAGE_SECTION libdevel)
# Devices and DDS profile come with hapticd, which libhaptic-client0 needs.
set(CPACK_DEBIAN_DEVELOPMENT_PACKAGE_DEPENDS "libhaptic-client0 (= ${PROJECT_VERSION}), libeigen3-dev, libsuitesparse-dev, libopenblas-dev, libfcl-dev, \
libccd-dev, liboctomap-dev, libboost-dev, cyclonedds-dev, cyclonedds-tools, libyaml-cpp-dev, cmake, pkg-config")
# The first line is the synopsis, of each its own.
set(CPACK_PACKAGE_DESCRIPTION_SUMMARY "")
set(CPACK_COMPONENT_RUNTIME_DESCRIPTION "haptic server for soft tissue that is being cut
A daemon with two loops: co-rotational finite elements at 50 Hz, and their
contact with an instrument solved again at 1 kHz for each new pose of a haptic
device, over DDS. Compiled for x86-64-v3 (AVX2). The programs link CHOLMOD's
parts under the GPL.")
set(CPACK_COMPONENT_CLIENT_DESCRIPTION "haptic server for soft tissue: C library for devices
A device on a running hapticd: poses out, forces back at 1 kHz, within the
device's limits. Nothing in it is under the GPL.")
set(CPACK_COMPONENT_PYTHON_DESCRIPTION "haptic server for soft tissue: Python
A device on a running hapticd, scenes without a daemon and recordings, as
NumPy arrays.")
set(CPACK_COMPONENT_DEVELOPMENT_DESCRIPTION "haptic server for soft tissue: libraries and headers
The C library's header, the .idl files, and the static libraries
hapticd::physics, hapticd::haptic and hapticd::driver with their CMake package.")
include(CPack)
