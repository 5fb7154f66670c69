# rustle_module(NAME FOLDER folder DEPENDS modules... LIBRARIES targets... SEPARATE)
#   One folder, one target. Every .cpp of the folder belongs to it; without one the target is header-only.
#   DEPENDS names the modules whose headers this one may include: the layering test holds the folder to exactly that.
#   SEPARATE compiles every file by itself where the others are compiled several at once (CMAKE_UNITY_BUILD, a third of
#   the time): the real-time paths, so that what is inlined into what depends on the file alone.
#   A header is compiled by itself only where no .cpp of its name includes it first, which the layering test demands.
# rustle_program(NAME SOURCES files... DEPENDS modules...)   a program in build/PRESET/bin
# rustle_unit_tests(MODULE DEPENDS modules...)               tests/unit/MODULE/*.cpp as the test unit.MODULE, each file's
#   contents in a namespace of its own, so that several can be compiled at once
# rustle_write_layers(file)                                  the declared layers, for the layering test

set(RUSTLE_SANITIZE "" CACHE STRING "Sanitizers to build with, as -fsanitize= takes them")

# What the sanitizers report of Debian's libraries.
set(RUSTLE_TEST_ENVIRONMENT
  "TSAN_OPTIONS=suppressions=${CMAKE_SOURCE_DIR}/tests/support/tsan.supp"
  "LSAN_OPTIONS=suppressions=${CMAKE_SOURCE_DIR}/tests/support/lsan.supp")

set(CMAKE_CXX_STANDARD 20)
set(CMAKE_CXX_STANDARD_REQUIRED ON)
set(CMAKE_CXX_EXTENSIONS OFF)
set(CMAKE_POSITION_INDEPENDENT_CODE ON)
set(CMAKE_RUNTIME_OUTPUT_DIRECTORY ${CMAKE_BINARY_DIR}/bin)

add_library(rustle_flags INTERFACE)
# -ffp-contract=off: the same samples whether the compiler's loop body or its tail computes them.
target_compile_options(rustle_flags INTERFACE -Wall -Wextra -Wpedantic -Wshadow -Wnon-virtual-dtor -Woverloaded-virtual
  -Wcast-qual -Werror -ffp-contract=off)
target_include_directories(rustle_flags INTERFACE ${CMAKE_SOURCE_DIR})
if(CMAKE_UNITY_BUILD)
  # Types of a .cpp's own take types of its anonymous namespace, which a unity source includes as it would a header.
  target_compile_options(rustle_flags INTERFACE -Wno-subobject-linkage)
endif()
if(RUSTLE_SANITIZE)
  add_compile_options(-fsanitize=${RUSTLE_SANITIZE} -fno-omit-frame-pointer -fno-sanitize-recover=all)
  add_link_options(-fsanitize=${RUSTLE_SANITIZE})
  if(RUSTLE_FUZZ)
    target_compile_options(rustle_flags INTERFACE -Wno-error)  # clang warns of other things than g++
  endif()
  # Instrumented code confuses g++ 12 about what is initialized; the plain builds keep the warning.
  target_compile_options(rustle_flags INTERFACE -Wno-maybe-uninitialized)
endif()

function(rustle_module name)
  cmake_parse_arguments(arg "SEPARATE" "FOLDER" "DEPENDS;LIBRARIES" ${ARGN})
  set(folder ${CMAKE_SOURCE_DIR}/${arg_FOLDER})
  file(GLOB sources CONFIGURE_DEPENDS ${folder}/*.cpp)
  file(GLOB headers CONFIGURE_DEPENDS ${folder}/*.h)
  list(TRANSFORM arg_DEPENDS PREPEND rustle_ OUTPUT_VARIABLE modules)
  if(sources)
    set(scope PUBLIC)
    add_library(rustle_${name} STATIC ${sources})
  else()
    set(scope INTERFACE)
    add_library(rustle_${name} INTERFACE)
  endif()
  target_link_libraries(rustle_${name} ${scope} rustle_flags ${modules} ${arg_LIBRARIES})
  if(arg_SEPARATE)
    set_target_properties(rustle_${name} PROPERTIES UNITY_BUILD OFF)
  endif()
  if(headers)
    list(TRANSFORM sources REPLACE "\\.cpp$" ".h" OUTPUT_VARIABLE included_first)
    set(alone ${headers})
    list(REMOVE_ITEM alone ${included_first})
    target_sources(rustle_${name} ${scope}
      FILE_SET HEADERS BASE_DIRS ${CMAKE_SOURCE_DIR} FILES ${headers}
      FILE_SET alone TYPE HEADERS BASE_DIRS ${CMAKE_SOURCE_DIR} FILES ${alone})
    set_target_properties(rustle_${name} PROPERTIES VERIFY_INTERFACE_HEADER_SETS ON INTERFACE_HEADER_SETS_TO_VERIFY alone)
  endif()
  list(JOIN arg_DEPENDS " " depends)
  set_property(GLOBAL APPEND PROPERTY RUSTLE_LAYERS "${name} ${arg_FOLDER} ${depends}")
endfunction()

function(rustle_program name)
  cmake_parse_arguments(arg "" "" "SOURCES;DEPENDS;LIBRARIES" ${ARGN})
  add_executable(${name} ${arg_SOURCES})
  set_target_properties(${name} PROPERTIES UNITY_BUILD OFF)
  list(TRANSFORM arg_DEPENDS PREPEND rustle_ OUTPUT_VARIABLE modules)
  target_link_libraries(${name} PRIVATE rustle_flags ${modules} ${arg_LIBRARIES})
endfunction()

function(rustle_unit_tests module)
  cmake_parse_arguments(arg "" "" "DEPENDS;LIBRARIES" ${ARGN})
  file(GLOB sources CONFIGURE_DEPENDS ${CMAKE_SOURCE_DIR}/tests/unit/${module}/*.cpp)
  if(NOT sources)
    return()
  endif()
  rustle_program(test_${module} SOURCES ${sources} DEPENDS ${module} test_support ${arg_DEPENDS} LIBRARIES ${arg_LIBRARIES})
  set_target_properties(test_${module} PROPERTIES RUNTIME_OUTPUT_DIRECTORY ${CMAKE_BINARY_DIR}/tests UNITY_BUILD "${CMAKE_UNITY_BUILD}")
  add_test(NAME unit.${module} COMMAND test_${module})
  set_tests_properties(unit.${module} PROPERTIES TIMEOUT 600 ENVIRONMENT "${RUSTLE_TEST_ENVIRONMENT}")
endfunction()

function(rustle_write_layers file)
  get_property(lines GLOBAL PROPERTY RUSTLE_LAYERS)
  set(text "")
  foreach(line IN LISTS lines)
    string(APPEND text "${line}\n")
  endforeach()
  file(WRITE ${file} "${text}")
endfunction()
