# The daemon's page: what Vite makes of server/page/web becomes BUILD/share/rustle/page, which rustled finds beside its
# folder, and the install component `page`. Whoever installs that needs no npm. Made again only when a source has changed;
# what npm installs stays in the build tree.
set(web ${CMAKE_SOURCE_DIR}/server/page/web)
find_program(RUSTLE_NPM npm)
mark_as_advanced(RUSTLE_NPM)
set(RUSTLE_PAGE AUTO CACHE STRING "Build the daemon's page, by npm, which fetches what package-lock.json names: ON, OFF, AUTO (where npm is)")
set_property(CACHE RUSTLE_PAGE PROPERTY STRINGS AUTO ON OFF)
set(rustle_has_page OFF)  # in this configuration
if(RUSTLE_NPM AND RUSTLE_PAGE STREQUAL AUTO OR RUSTLE_PAGE AND NOT RUSTLE_PAGE STREQUAL AUTO)
  set(rustle_has_page ON)
endif()

if(rustle_has_page)
  if(NOT RUSTLE_NPM)
    message(FATAL_ERROR "RUSTLE_PAGE needs npm; install it (Debian: nodejs npm), or configure with -DRUSTLE_PAGE=OFF")
  endif()
  file(GLOB_RECURSE page_sources CONFIGURE_DEPENDS ${web}/src/*)
  file(GLOB page_settings CONFIGURE_DEPENDS ${web}/index.html ${web}/vite.config.ts ${web}/tsconfig*.json)
  set(page_packages ${web}/package.json ${web}/package-lock.json)
  set(work ${CMAKE_BINARY_DIR}/page)
  set(page ${CMAKE_BINARY_DIR}/share/rustle/page)

  add_custom_command(OUTPUT ${work}/packages.stamp
    COMMAND ${CMAKE_COMMAND} -E make_directory ${work}
    COMMAND ${CMAKE_COMMAND} -E copy ${page_packages} ${work}
    COMMAND ${CMAKE_COMMAND} -E chdir ${work} ${RUSTLE_NPM} ci --no-audit --no-fund --loglevel=error
    COMMAND ${CMAKE_COMMAND} -E touch ${work}/packages.stamp
    DEPENDS ${page_packages}
    COMMENT "Fetching what the page is built with (without network: -DRUSTLE_PAGE=OFF)")
  # Removed first: what is no longer among the sources, or was built of others, is not to stay.
  add_custom_command(OUTPUT ${page}/index.html
    COMMAND ${CMAKE_COMMAND} -E rm -rf ${work}/src ${work}/dist ${page}
    COMMAND ${CMAKE_COMMAND} -E copy ${page_settings} ${work}
    COMMAND ${CMAKE_COMMAND} -E copy_directory ${web}/src ${work}/src
    COMMAND ${CMAKE_COMMAND} -E chdir ${work} ${RUSTLE_NPM} run build --silent
    COMMAND ${CMAKE_COMMAND} -E copy_directory ${work}/dist ${page}
    COMMAND ${CMAKE_COMMAND} -E touch ${page}/index.html
    DEPENDS ${work}/packages.stamp ${page_packages} ${page_settings} ${page_sources}
    COMMENT "Building the daemon's page")
  add_custom_target(rustle_page_files ALL DEPENDS ${page}/index.html)
endif()
