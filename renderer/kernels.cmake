# SPDX-License-Identifier: Apache-2.0
# Loops over voxels and pixels are compiled once per instruction set: see base/isa.h.
#
#   splat_kernels(FILE...)   called from a folder: adds its sources to those of every set, in place of target_sources(splat …)

include(CheckCSourceCompiles)
check_c_source_compiles("#ifndef __x86_64__\n#error\n#endif\nint main(void) { return 0; }" SPLATD_X86_64)
check_c_source_compiles("#ifndef __aarch64__\n#error\n#endif\nint main(void) { return 0; }" SPLATD_AARCH64)

# No errno, no floating-point traps; the rest of IEEE stays (-ffast-math would break sp_exp2's rounding).
set(flags -O3 -fno-math-errno -fno-trapping-math)
if(SPLATD_SANITIZE)
    list(TRANSFORM flags REPLACE -O3 -O2)
endif()
# The reference also keeps each operation's own rounding; the others may join a product and a sum.
set(flags_scalar ${flags} -ffp-contract=off)
set(flags_wide ${flags} -ffp-contract=fast -fno-signed-zeros)
set(flags_sse41 ${flags_wide} -msse4.1)
set(flags_avx2 ${flags_wide} -mavx2 -mfma -mf16c -mbmi -mbmi2)
set(flags_avx512 ${flags_avx2} -mavx512f -mavx512bw -mavx512dq -mavx512vl -mprefer-vector-width=512)
set(flags_neon ${flags_wide})

set(SPLAT_ISAS scalar)
if(SPLATD_SANITIZE STREQUAL thread)
    # Scalar alone: all sets have the same threads.
elseif(SPLATD_SANITIZE AND SPLATD_X86_64)
    # The widest set of this machine too: under a sanitizer, tests draw with these two. The release build runs the tests of
    # kernels, which put guard zones around memory, with all sets.
    include(CheckCSourceRuns)
    check_c_source_runs("int main(void) { return !__builtin_cpu_supports(\"avx512vl\"); }" SPLATD_RUNS_AVX512)
    check_c_source_runs("int main(void) { return !__builtin_cpu_supports(\"avx2\"); }" SPLATD_RUNS_AVX2)
    if(SPLATD_RUNS_AVX512)
        list(APPEND SPLAT_ISAS avx512)
    elseif(SPLATD_RUNS_AVX2)
        list(APPEND SPLAT_ISAS avx2)
    else()
        list(APPEND SPLAT_ISAS sse41)
    endif()
elseif(SPLATD_X86_64)
    list(APPEND SPLAT_ISAS sse41 avx2 avx512)
elseif(SPLATD_AARCH64)
    list(APPEND SPLAT_ISAS neon)
endif()

foreach(isa ${SPLAT_ISAS})
    add_library(splat_kernels_${isa} OBJECT)
    target_include_directories(splat_kernels_${isa} PRIVATE ${CMAKE_CURRENT_SOURCE_DIR} ${CMAKE_CURRENT_SOURCE_DIR}/include)
    target_link_libraries(splat_kernels_${isa} PRIVATE splatd_warnings)
    target_compile_options(splat_kernels_${isa} PRIVATE ${flags_${isa}})
    if(NOT isa STREQUAL scalar)
        target_compile_definitions(splat_kernels_${isa} PRIVATE SP_ISA=${isa})
    endif()
    target_sources(splat PRIVATE $<TARGET_OBJECTS:splat_kernels_${isa}>)
endforeach()

# The dispatcher asks which sets are compiled.
foreach(isa sse41 avx2 avx512 neon)
    string(TOUPPER ${isa} name)
    list(FIND SPLAT_ISAS ${isa} index)
    list(APPEND compiled SP_WITH_${name}=$<NOT:$<EQUAL:${index},-1>>)
endforeach()
set_property(SOURCE backend/cpu/kernels.c APPEND PROPERTY COMPILE_DEFINITIONS ${compiled})

function(splat_kernels)
    foreach(isa ${SPLAT_ISAS})
        foreach(source ${ARGN})
            target_sources(splat_kernels_${isa} PRIVATE ${CMAKE_CURRENT_SOURCE_DIR}/${source})
        endforeach()
    endforeach()
endfunction()
