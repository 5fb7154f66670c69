# What `cmake --install` puts where, by component:
#   daemon   rustled, its service unit, its configuration, dashboard, README and licence
#   tools    rustle
#            (both with manual pages and completions)
#   packs    the default sound packs, which both programs find beside their folder
#   page     what rustled shows in a browser, found the same way
#   python   the Python SDK
#   library  the C SDK's shared library
#   dev      the C and C++ SDKs: headers, archive, messages, and what find_package and pkg-config read
#
#   cmake --install build/release --prefix ~/.local                      everything
#   DESTDIR=/tmp/root cmake --install build/release --component python   one component
include(GNUInstallDirs)
include(CMakePackageConfigHelpers)

set(RUSTLE_PYTHON_DIR lib/python3/dist-packages CACHE STRING "Where the Python SDK is installed, below the prefix")
set(RUSTLE_SYSTEMD_DIR lib/systemd CACHE STRING "Where the folder of systemd's units is, below the prefix")
set(RUSTLE_ZSH_FOLDER site-functions CACHE STRING "The folder of zsh's completions, vendor-completions in packages")

# ---- programs

install(TARGETS rustled RUNTIME COMPONENT daemon)
install(TARGETS rustle RUNTIME COMPONENT tools)
install(DIRECTORY ${CMAKE_BINARY_DIR}/share/rustle/packs DESTINATION ${CMAKE_INSTALL_DATADIR}/rustle COMPONENT packs)
if(rustle_has_page)
  install(DIRECTORY ${CMAKE_BINARY_DIR}/share/rustle/page DESTINATION ${CMAKE_INSTALL_DATADIR}/rustle COMPONENT page)
endif()
if(RUSTLE_PACKAGES)  # Debian keeps a package's documentation by its name, and the licence's text in one place
  install(FILES README.md DESTINATION ${CMAKE_INSTALL_DATAROOTDIR}/doc/rustled COMPONENT daemon)
else()
  install(FILES README.md LICENSE DESTINATION ${CMAKE_INSTALL_DOCDIR} COMPONENT daemon)
endif()
install(FILES deploy/grafana/rustle.json DESTINATION ${CMAKE_INSTALL_DATADIR}/rustle/grafana COMPONENT daemon)
file(READ deploy/systemd/rustled.service unit)
string(REPLACE /usr/bin/rustled ${CMAKE_INSTALL_FULL_BINDIR}/rustled unit "${unit}")
string(REPLACE /etc/rustle ${CMAKE_INSTALL_FULL_SYSCONFDIR}/rustle unit "${unit}")
file(GENERATE OUTPUT ${CMAKE_BINARY_DIR}/install/rustled.service CONTENT "${unit}")
install(FILES ${CMAKE_BINARY_DIR}/install/rustled.service DESTINATION ${RUSTLE_SYSTEMD_DIR}/system COMPONENT daemon)
install(FILES deploy/systemd/sysusers.conf DESTINATION lib/sysusers.d RENAME rustle.conf COMPONENT daemon)
set(configuration_folder ${CMAKE_INSTALL_SYSCONFDIR})
if(RUSTLE_PACKAGES)
  set(configuration_folder ${CMAKE_INSTALL_FULL_SYSCONFDIR})  # /etc, of the prefix /usr
endif()
install(FILES ${CMAKE_BINARY_DIR}/manual/rustled.toml DESTINATION ${configuration_folder}/rustle COMPONENT daemon)

# ---- manual pages and completions, written of the command lines

foreach(pair rustled:daemon rustle:tools)
  string(REGEX MATCH "^[^:]+" program ${pair})
  string(REGEX MATCH "[^:]+$" component ${pair})
  foreach(section 1 5)
    install(DIRECTORY ${CMAKE_BINARY_DIR}/manual/man/${program}/ DESTINATION ${CMAKE_INSTALL_MANDIR}/man${section} COMPONENT ${component}
      FILES_MATCHING PATTERN *.${section}.gz)
  endforeach()
  set(completions ${CMAKE_BINARY_DIR}/manual)
  install(FILES ${completions}/bash/${program} DESTINATION ${CMAKE_INSTALL_DATADIR}/bash-completion/completions COMPONENT ${component})
  install(FILES ${completions}/zsh/_${program} DESTINATION ${CMAKE_INSTALL_DATADIR}/zsh/${RUSTLE_ZSH_FOLDER} COMPONENT ${component})
  install(FILES ${completions}/fish/${program}.fish DESTINATION ${CMAKE_INSTALL_DATADIR}/fish/vendor_completions.d COMPONENT ${component})
endforeach()

# ---- SDKs

install(DIRECTORY ${CMAKE_BINARY_DIR}/python/rustle DESTINATION ${RUSTLE_PYTHON_DIR} COMPONENT python PATTERN __pycache__ EXCLUDE)

set(headers certificate connection observation_reader pcm_reader session types)
list(TRANSFORM headers REPLACE "(.+)" "client_sdk/cpp/\\1.h")
set(include_folder ${CMAKE_INSTALL_INCLUDEDIR}/rustle)
install(FILES ${headers} DESTINATION ${include_folder}/client_sdk/cpp COMPONENT dev)
install(DIRECTORY proto/rustle DESTINATION ${CMAKE_INSTALL_DATADIR}/rustle/proto COMPONENT dev FILES_MATCHING PATTERN *.proto)
install(DIRECTORY ${CMAKE_BINARY_DIR}/proto/rustle DESTINATION ${include_folder} COMPONENT dev FILES_MATCHING PATTERN *.pb.h)
install(TARGETS rustle_sdk EXPORT rustle ARCHIVE COMPONENT dev INCLUDES DESTINATION ${include_folder})

install(FILES client_sdk/c/rustle.h DESTINATION ${include_folder} COMPONENT dev)
install(TARGETS rustle_sdk_c EXPORT rustle_c LIBRARY COMPONENT library NAMELINK_COMPONENT dev INCLUDES DESTINATION ${include_folder})

set(package ${CMAKE_INSTALL_LIBDIR}/cmake/rustle)
set(generated ${CMAKE_BINARY_DIR}/install)
install(EXPORT rustle FILE rustleClient.cmake NAMESPACE rustle:: DESTINATION ${package} COMPONENT dev)
install(EXPORT rustle_c FILE rustleClientC.cmake NAMESPACE rustle:: DESTINATION ${package} COMPONENT dev)
configure_package_config_file(deploy/cmake/rustleConfig.cmake.in ${generated}/rustleConfig.cmake INSTALL_DESTINATION ${package}
  NO_SET_AND_CHECK_MACRO)
write_basic_package_version_file(${generated}/rustleConfigVersion.cmake COMPATIBILITY SameMinorVersion)
install(FILES ${generated}/rustleConfig.cmake ${generated}/rustleConfigVersion.cmake DESTINATION ${package} COMPONENT dev)

set(pc_to_prefix /prefix)  # wherever that is when they are used
cmake_path(RELATIVE_PATH pc_to_prefix BASE_DIRECTORY /prefix/${CMAKE_INSTALL_LIBDIR}/pkgconfig)
foreach(name rustle-client rustle-client-c)
  configure_file(deploy/cmake/${name}.pc.in ${generated}/${name}.pc @ONLY)
  install(FILES ${generated}/${name}.pc DESTINATION ${CMAKE_INSTALL_LIBDIR}/pkgconfig COMPONENT dev)
endforeach()
