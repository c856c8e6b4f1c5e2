# cl-nascent: plain GNU make. Only build/ is written.
#   make                    build/cl-nascent, and the library: libcl-nascent.a and .so
#   make demo               install missing packages, generate, train two minutes, evaluate, render
#   make test | check       install missing packages, run what every change is to pass
#   make test-all           the whole suite, three times as long: before a release
#   make test-devices       the cases of docs/devices.md on every OpenCL device found
#   make test-browser       the viewer's page in headless Chromium (a large download; not in test)
#   make grind              the kernels under Oclgrind, for races and bad accesses
#   make fuzz               the readers of foreign bytes under libFuzzer: SECONDS=600 each, TARGETS=
#   make faults             kill -9, full disks, failing memory and devices: FAULTS=50 of each kind
#   make lint | fmt         check, or apply, the house style
#   make bench-programs     what the scripts in bench/ need (docs/benches.md)
#   make bench-peers        build/bench-peers: leaf networks beside installed libraries
#   make bench              install missing packages, time every kernel (docs/benches.md)
#   make bench-sort         the sort beside other sorts (needs g++)
#   make bench-scale        what 1 to 1,024 processes would do (needs libopenmpi-dev openmpi-bin)
#   make install            program and library: PREFIX=/usr/local DESTDIR=, and BINDIR, LIBDIR,
#                           INCLUDEDIR, DATADIR, MANDIR, DOCDIR, as below; uninstall with the same
#   make dist               the sources of HEAD, build/cl-nascent-VERSION.tar.xz
#   make deb                a Debian package of the program, in build/
#   make deps | clean       install what the build needs; remove build/
#   make help               this text
# Variables: SANITIZE=address,undefined  DEBUG=1  WERROR=1  V=1 (show the commands)
#            B=FOLDER: for what is built, in place of build; also of clean. Objects are not
#            built anew when flags change: give other flags another folder
#            CC AR OBJCOPY PKG_CONFIG CPPFLAGS CFLAGS LDFLAGS, as usual; HOSTPROG: see below
#            MPI=1: build/mpi/cl-nascent and library, for training by several processes
#            (docs/scale-out.md; libopenmpi-dev)
# Packagers: EXPAT= LCMS2= MICROHTTPD= MESHOPTIMIZER= UTF8PROC= leave these libraries out, whether
# they are there or not; each by itself, too. Else they are used if they are found, which `version
# -v` tells.

# GNU's spelling (make install prefix=/usr) is taken, too.
$(foreach name,prefix:PREFIX bindir:BINDIR libdir:LIBDIR includedir:INCLUDEDIR datadir:DATADIR \
               mandir:MANDIR docdir:DOCDIR,$(foreach theirs,$(firstword $(subst :, ,$(name))),\
    $(if $(filter command,$(origin $(theirs))),\
         $(eval $(lastword $(subst :, ,$(name))) := $($(theirs))))))
PREFIX ?= /usr/local
BINDIR ?= $(PREFIX)/bin
LIBDIR ?= $(PREFIX)/lib
INCLUDEDIR ?= $(PREFIX)/include
DATADIR ?= $(PREFIX)/share
MANDIR ?= $(DATADIR)/man
DOCDIR ?= $(DATADIR)/doc/cl-nascent
BASHDIR ?= $(DATADIR)/bash-completion/completions
ZSHDIR ?= $(DATADIR)/zsh/site-functions
FISHDIR ?= $(DATADIR)/fish/vendor_completions.d
# From here on relative ones are absolute, as they stand in the file of pkg-config. Not by abspath,
# which takes a folder with a space for two.
$(foreach name,PREFIX BINDIR LIBDIR INCLUDEDIR DATADIR MANDIR DOCDIR BASHDIR ZSHDIR FISHDIR,\
    $(if $(filter-out /%,$(firstword $($(name)))),\
         $(eval override $(name) := $(CURDIR)/$($(name)))))
B := build$(if $(SANITIZE),/sanitize)$(if $(DEBUG),/debug)

CC ?= gcc
OBJCOPY ?= objcopy
PKG_CONFIG ?= pkg-config
# runs here and writes manual pages and completion; another one in a cross build
HOSTPROG ?= $P/cl-nascent
STB := $(or $(patsubst -I%,-isystem %,$(shell $(PKG_CONFIG) --cflags stb 2>/dev/null)), \
         -isystem /usr/include/stb)
# the viewer's server; without it `view` says what is missing
MICROHTTPD := $(shell $(PKG_CONFIG) --exists libmicrohttpd && echo libmicrohttpd)
# for photos with colour profiles; without it their colours count as sRGB's, which is said
LCMS2 := $(shell $(PKG_CONFIG) --exists lcms2 && echo lcms2)
# for names of files in the other Unicode form, as of a Mac; without it they are not found
UTF8PROC := $(shell $(PKG_CONFIG) --exists libutf8proc && echo libutf8proc)
# for Metashape's cameras.xml; without it such a file is refused, with a way out
EXPAT := $(shell $(PKG_CONFIG) --exists expat && echo expat)
PKGS := OpenCL jansson zlib $(MICROHTTPD) $(LCMS2) $(UTF8PROC) $(EXPAT)
# for export --mesh --triangles; without it that option says what is missing. It has no pkg-config.
# A header alone may be another machine's: a cross compiler looks into /usr/include, too.
MESHOPTIMIZER := $(shell echo 'int main(void) { return 0; }' | $(CC) -include meshoptimizer.h \
                         -x c - -o /dev/null -lmeshoptimizer 2>/dev/null && echo meshoptimizer)
CLANG ?= $(firstword $(shell command -v clang-14 clang))
CLANG_FORMAT ?= $(firstword $(shell command -v clang-format-14 clang-format))
# reports of sanitizers have lines; compiling takes half the time of -O1 -g
OPT := $(if $(DEBUG),-O0 -g,$(if $(SANITIZE),-Og -g1,-O2 -g))
# tests run once after they are compiled
$B/obj/tests/%: OPT := $(if $(DEBUG),-O0 -g,-Og -g1)
VERSION := $(shell sed -n 's/^\#define CLN_VERSION "\(.*\)"/\1/p' include/cl_nascent.h)
# The shared library's name for the linker. From 1.0 on it changes when a function or struct of
# cl_nascent.h does; 0 promises nothing (docs/api.md).
SONAME := libcl-nascent.so.0
WARN := -Wall -Wextra -Wshadow -Wstrict-prototypes -Wmissing-prototypes $(if $(WERROR),-Werror)
CFLAGS_ALL = -std=c11 -D_GNU_SOURCE $(OPT) $(WARN) -fPIC -fvisibility=hidden \
             -Iinclude -Ihost -Ibench -Itests/support $(STB) \
             $(if $(SANITIZE),-fsanitize=$(SANITIZE) -fno-omit-frame-pointer) \
             $(if $(MICROHTTPD),-DCLN_WITH_MICROHTTPD) \
             $(if $(MESHOPTIMIZER),-DCLN_WITH_MESHOPTIMIZER) \
             $(if $(LCMS2),-DCLN_WITH_LCMS2) \
             $(if $(UTF8PROC),-DCLN_WITH_UTF8PROC) \
             $(if $(EXPAT),-DCLN_WITH_EXPAT) \
             -ffile-prefix-map="$(CURDIR)"=. $(shell $(PKG_CONFIG) --cflags $(PKGS)) \
             $(CPPFLAGS) $(CFLAGS)
LIBS_PRIVATE = $(if $(MICROHTTPD),-lmicrohttpd )$(if $(UTF8PROC),-lutf8proc )\
               $(MESHOPTIMIZER:%=-l% )-lm -lpthread
LDLIBS_ALL = -ffile-prefix-map="$(CURDIR)"=. \
             $(shell $(PKG_CONFIG) --libs $(PKGS) $(MPI_PKG)) $(MESHOPTIMIZER:%=-l%) \
             -lm -lpthread $(if $(SANITIZE),-fsanitize=$(SANITIZE)) $(LDFLAGS)

LIB_SRC := $(filter-out host/cli/%,$(wildcard host/*/*.c))
CLI_SRC := $(wildcard host/cli/*.c)
DATA_SRC := $(wildcard data/*.c)
# separate programs and a library, for cli.sh, devices.sh, fuzz.sh and faults.sh
TEST_OWN := tests/support/json_query.c tests/support/copies.c tests/device/device_cases.c \
            tests/support/faults.c tests/support/two_threads.c $(wildcard tests/fuzz/*.c)
TEST_SRC := $(filter-out $(TEST_OWN),$(wildcard tests/*/*.c))
# bench-table: runs side by side, for the scene benches
TABLE_SRC := bench/scenes/table.c bench/common/plot.c
# bench-views: error of views by their distance from the training cameras
VIEWS_SRC := bench/scenes/views.c
# bench-floaters: opacity where a generated scene is empty
FLOATERS_SRC := bench/scenes/floaters.c
# bench-peers: the leaf networks beside installed libraries for small products
PEER_MAIN := bench/peers/peer_gemm.c
# bench-growth: cost over leaves, samples, pixels, for bench/growth/growth.sh
GROWTH_SRC := bench/growth/growth.c bench/common/plot.c
# bench-scale: training by ranks, measured and computed, for bench/scale/scale.sh; with MPI=1
SCALE_SRC := $(wildcard bench/scale/*.c)
BENCH_SRC := $(wildcard bench/kernels/*.c)
# MPI=1: one object differs, and what is linked goes to a folder of its own
MPI_PKG := $(if $(MPI),ompi-c)
P := $B$(if $(MPI),/mpi)
RANKS_OBJ := $(if $(MPI),$B/obj/mpi/ranks.o,$B/obj/host/ranks/ranks.o)
LIB_OBJ := $(filter-out %/ranks/ranks.o,$(LIB_SRC:%.c=$B/obj/%.o)) $(RANKS_OBJ) \
           $B/obj/kernels_embed.o $B/obj/pages_embed.o
CLI_OBJ := $(CLI_SRC:%.c=$B/obj/%.o)
DATA_OBJ := $(DATA_SRC:%.c=$B/obj/%.o)
# the tests also see the option table and the ray tracer of the generator
TEST_OBJ := $(TEST_SRC:%.c=$B/obj/%.o) $B/obj/test_groups.o $(filter-out %/main.o,$(CLI_OBJ)) \
            $(filter-out %/make_scene.o,$(DATA_OBJ)) $B/obj/bench/scale/model.o
# programs stay built, see tests/support/kept_programs.c
TEST_LINK := -Wl,--wrap=clCreateContext,--wrap=clCreateProgramWithSource,--wrap=clBuildProgram \
             -lcmocka
# the fuzz targets: digests and checksums are 0 in them, see tests/fuzz/fuzz.c
FUZZ_OBJ := $B/obj/tests/fuzz/fuzz.o $(filter-out %/main.o,$(CLI_OBJ)) $B/libcl-nascent.a
FUZZ_LINK := -Wl,--wrap=cln_digest,--wrap=crc32 -lcmocka
BENCH_OBJ := $(BENCH_SRC:%.c=$B/obj/%.o) $B/obj/bench/common/plot.o
TABLE_OBJ := $(TABLE_SRC:%.c=$B/obj/%.o)
VIEWS_OBJ := $(VIEWS_SRC:%.c=$B/obj/%.o)
FLOATERS_OBJ := $(FLOATERS_SRC:%.c=$B/obj/%.o)
GROWTH_OBJ := $(GROWTH_SRC:%.c=$B/obj/%.o)
SCALE_OBJ := $(SCALE_SRC:%.c=$B/obj/%.o)
ALL_SRC := $(sort $(LIB_SRC) $(CLI_SRC) $(DATA_SRC) $(TEST_SRC) $(BENCH_SRC) $(TABLE_SRC) \
             $(VIEWS_SRC) $(FLOATERS_SRC) $(GROWTH_SRC) $(SCALE_SRC) $(PEER_MAIN) $(TEST_OWN))
KERNELS := $(wildcard kernels/*.cl kernels/*.h) include/device_abi.h
PAGES := $(wildcard host/view/page.*) $(addprefix host/view/,path.js crop.js training.js)
TUNE_ROWS := $(wildcard data/tune/*.txt)
EXAMPLES := $(wildcard examples/*.c)

SAY = $(if $V,,@echo "  $1";)

all: $P/cl-nascent $P/libcl-nascent.a $P/$(SONAME) $P/cl-nascent.pc $P/texts \
     $P/public/libcl-nascent.a

# Programs of objects and the library, all linked in one way.
PROGRAMS := $P/cl-nascent $P/bench-scale \
            $(addprefix $B/,make-scene json-query voxel-copies device-cases bench-kernels \
                            bench-table bench-views bench-floaters bench-growth)
$P/cl-nascent: $(CLI_OBJ) $P/libcl-nascent.a
$P/bench-scale: $(SCALE_OBJ) $P/libcl-nascent.a
$B/make-scene: $(DATA_OBJ) $B/libcl-nascent.a
$B/json-query: $B/obj/tests/support/json_query.o
$B/voxel-copies: $B/obj/tests/support/copies.o $B/libcl-nascent.a
$B/device-cases: $B/obj/tests/device/device_cases.o $B/libcl-nascent.a
$B/bench-kernels: $(BENCH_OBJ) $B/libcl-nascent.a
$B/bench-table: $(TABLE_OBJ) $B/libcl-nascent.a
$B/bench-views: $(VIEWS_OBJ) $B/libcl-nascent.a
$B/bench-floaters: $(FLOATERS_OBJ) $B/libcl-nascent.a
$B/bench-growth: $(GROWTH_OBJ) $B/libcl-nascent.a
$(PROGRAMS):
	$(call SAY,LINK $@)$(CC) $^ $(LDLIBS_ALL) -o $@

$P/libcl-nascent.a: $(LIB_OBJ)
	@mkdir -p $(@D)
	@rm -f $@
	$(call SAY,AR $@)$(AR) rcs $@ $^

# What is installed: one object whose inner names are its own, so that a program may have stb_image,
# or other functions of these names, too. Tests and benches link with the one above. Under
# sanitizers names stay, as their tables need some, and with clang's -flto, whose objects are no
# code yet. With gcc's -flto it is compiled here.
LTO = $(findstring -flto,$(CFLAGS) $(OPT) $(CC))
OPEN_NAMES = $(or $(SANITIZE),$(if $(LTO),$(findstring clang,$(shell $(CC) --version))))
$P/public/libcl-nascent.a: $(LIB_OBJ)
	@mkdir -p $(@D)
	@rm -f $@
	$(call SAY,AR $@)$(if $(OPEN_NAMES),$(AR) rcs $@ $^, \
	    $(CC) -r -nostdlib $(filter -m%,$(CFLAGS)) $(if $(LTO),-flinker-output=nolto-rel) $^ \
	        -o $(@D)/cl-nascent.o && \
	    $(OBJCOPY) --localize-hidden $(@D)/cl-nascent.o && \
	    $(AR) rcs $@ $(@D)/cl-nascent.o && rm $(@D)/cl-nascent.o)

# It exports only what cl_nascent.h marks CLN_API.
$P/$(SONAME): $(LIB_OBJ)
	@mkdir -p $(@D)
	$(call SAY,LINK $@)$(CC) -shared -Wl,-soname,$(SONAME) -Wl,-z,defs $^ $(LDLIBS_ALL) -o $@

# Static linking also needs the library's dependencies (pkg-config --static); libmicrohttpd by name,
# as its own file asks for static dependencies that Debian's package does not bring.
# Spaces in folders are escaped.
empty :=
escaped = $(subst $(empty) ,\ ,$1)
by_prefix = $(call escaped,$(subst ^,,$(subst ^$(PREFIX)/,$${prefix}/,^$1)))
$P/cl-nascent.pc: include/cl_nascent.h Makefile FORCE
	@mkdir -p $(@D)
	@{ echo 'prefix=$(call escaped,$(PREFIX))'; \
	   echo 'libdir=$(call by_prefix,$(LIBDIR))'; \
	   echo 'includedir=$(call by_prefix,$(INCLUDEDIR))'; \
	   echo; \
	   echo 'Name: cl-nascent'; \
	   echo 'Description: Posed photos in, views from anywhere out, on any OpenCL device'; \
	   echo 'Version: $(VERSION)'; \
	   echo 'Requires.private: $(filter-out libmicrohttpd libutf8proc,$(PKGS)) $(MPI_PKG)'; \
	   echo 'Libs: -L$${libdir} -lcl-nascent'; \
	   echo 'Libs.private: $(LIBS_PRIVATE)'; \
	   echo 'Cflags: -I$${includedir}'; } > $@.new
	@if cmp -s $@.new $@; then rm $@.new; else mv $@.new $@; fi

# What the program writes about itself: a manual page per command, completion of three shells.
$P/texts: $P/cl-nascent docs/cl-nascent.1 packaging/man-pages.sh
	@rm -rf $@ $@.new
	@mkdir -p $@.new
	@packaging/man-pages.sh "$(HOSTPROG)" $@.new
	@for shell in bash zsh fish; do \
	   "$(HOSTPROG)" completion $$shell >$@.new/completion.$$shell || exit 1; \
	 done
	@mv $@.new $@

$B/tests: $(TEST_OBJ) $B/libcl-nascent.a
	$(call SAY,LINK $@)$(CC) $^ $(LDLIBS_ALL) $(TEST_LINK) -o $@

$B/fuzz: $(FUZZ_OBJ)
	$(call SAY,LINK $@)$(CC) $^ $(LDLIBS_ALL) -fsanitize=fuzzer $(FUZZ_LINK) -o $@

$B/fuzz-alone: $B/obj/tests/fuzz/alone.o $(FUZZ_OBJ)
	$(call SAY,LINK $@)$(CC) $^ $(LDLIBS_ALL) $(FUZZ_LINK) -o $@

$B/faults.so: $B/obj/tests/support/faults.o
	$(call SAY,LINK $@)$(CC) -shared $^ -ldl -o $@

$B/bench-sort: bench/peers/peer_sort.cpp $B/libcl-nascent.a
	$(call SAY,CXX $@)$(CXX) -std=c++17 -D_GNU_SOURCE -O3 -march=native -fopenmp -Wall -Wextra \
	    -Iinclude -Ihost $(shell $(PKG_CONFIG) --cflags $(PKGS)) $^ $(LDLIBS_ALL) -o $@

# A peer is a file in bench/peers, a header to detect it by, and libraries to link.
PEERS := xsmm onednn openblas clblast
PEER_HEADER_xsmm := libxsmm.h
PEER_HEADER_onednn := oneapi/dnnl/dnnl.h
PEER_HEADER_openblas := openblas_config.h
PEER_HEADER_clblast := clblast_c.h
PEER_LIBS_xsmm := -lxsmm -ldl
PEER_LIBS_onednn := -ldnnl
PEER_LIBS_openblas = $(shell $(PKG_CONFIG) --libs openblas 2>/dev/null)
PEER_LIBS_clblast := -lclblast
PEER_PACKAGES := libxsmm-dev libdnnl-dev libopenblas-dev libclblast-dev
PEER_CFLAGS_openblas = $(shell $(PKG_CONFIG) --cflags openblas 2>/dev/null)
found_peer = $(shell $(CC) $(PEER_CFLAGS_$1) -fsyntax-only -include $(PEER_HEADER_$1) \
               -x c /dev/null 2>/dev/null && echo $1)
MISSING = $(filter-out $(FOUND),$(PEERS))
not_installed = $(if $(MISSING),; not installed: $(MISSING) (of $(PEER_PACKAGES)))

bench-peers: $B/libcl-nascent.a
	@tests/deps.sh build
	@$(MAKE) --no-print-directory $B/bench-peers \
	    FOUND="$(strip $(foreach p,$(PEERS),$(call found_peer,$p)))"

# One command, as these need special flags: this processor's instructions, OpenMP, vectorised
# activations (which trapping mathematics would forbid), each one's library.
$B/bench-peers: $(PEER_MAIN) $(wildcard bench/peers/*) $B/libcl-nascent.a FORCE
	@echo "  peers: $(or $(FOUND),none)$(not_installed)"
	$(call SAY,LINK $@)$(CC) $(CFLAGS_ALL) -O3 -march=native -fno-trapping-math -fopenmp \
	    $(foreach p,$(FOUND),-DPEER_$(shell echo $p | tr a-z A-Z) $(PEER_CFLAGS_$p)) \
	    $(PEER_MAIN) bench/peers/timing.c bench/peers/cpu.c $(FOUND:%=bench/peers/%.c) \
	    $B/libcl-nascent.a \
	    $(foreach p,$(FOUND),$(PEER_LIBS_$p)) $(LDLIBS_ALL) -o $@

$B/obj/%.o: %.c
	@mkdir -p $(@D)
	$(call SAY,CC $<)$(CC) $(CFLAGS_ALL) -MMD -MP -c $< -o $@

# Each line of a file that the program has in it becomes a C string literal, so that the limit on
# literal length does not matter and build logs can name file and line.
AS_STRINGS := sed -e 's/\\/\\\\/g' -e 's/["?]/\\&/g' -e 's/.*/"&\\n",/'
$B/kernels_embed.c: $(KERNELS) $(TUNE_ROWS) Makefile
	@mkdir -p $(@D)
	@{ echo '/* Generated from kernels/, include/device_abi.h and data/tune/ by make. */'; \
	   echo '#include "device/kernel_source.h"'; \
	   for f in $(KERNELS) $(TUNE_ROWS); do \
	     n=$$(basename $$f | tr . _); \
	     echo "static const char *const $${n}[] = {"; \
	     $(AS_STRINGS) $$f; \
	     echo '0};'; \
	   done; \
	   echo 'const cln_kernel_source cln_kernel_sources[] = {'; \
	   for f in $(KERNELS); do \
	     n=$$(basename $$f); echo "{\"$$n\", $$(echo $$n | tr . _)},"; \
	   done; \
	   echo '{0, 0}};'; \
	   echo 'const cln_kernel_source cln_tune_sources[] = {'; \
	   for f in $(TUNE_ROWS); do \
	     n=$$(basename $$f); echo "{\"$$n\", $$(echo $$n | tr . _)},"; \
	   done; \
	   echo '{0, 0}};'; } > $@.new && mv $@.new $@

$B/obj/mpi/ranks.o: host/ranks/ranks.c
	@mkdir -p $(@D)
	$(call SAY,CC $< with MPI)$(CC) $(CFLAGS_ALL) -DCLN_WITH_MPI \
	    $(shell $(PKG_CONFIG) --cflags-only-I ompi-c) -MMD -MP -c $< -o $@

$B/pages_embed.c: $(PAGES) Makefile
	@mkdir -p $(@D)
	@{ echo '/* Generated from the viewer'\''s page by make. */'; \
	   echo '#include "view/pages.h"'; \
	   for f in $(PAGES); do \
	     echo "const char *const cln_$$(basename $$f | tr . _)[] = {"; \
	     $(AS_STRINGS) $$f; \
	     echo '0};'; \
	   done; } > $@.new && mv $@.new $@

# Compiled anew when their libraries come or go.
$(addprefix $B/obj/,host/view/server.o host/view/server_none.o host/export/reduce.o \
    host/cli/help.o host/io/colour.o host/base/unicode.o host/scene/metashape.o \
    tests/export/test_reduce.o tests/io/test_colour.o tests/scene/test_metashape.o): $B/optional
# The program names its commit: git's, or that of the archive.
# Of another account's clone, too, as `make install` by root reads it: else all would be made anew.
COMMIT = $(or $(shell if [ -e .git ]; then git -c safe.directory='*' describe --always --dirty \
                              --abbrev=12 2>/dev/null; \
                      else sed '/Format/d' packaging/commit | cut -c1-12; fi),unknown)
$B/obj/host/base/commit.o: override CFLAGS += -DCLN_COMMIT='"$(COMMIT)"'
$B/obj/host/base/commit.o: $B/commit
$B/commit: FORCE
	@mkdir -p $(@D)
	@echo '$(COMMIT)' | cmp -s - $@ || echo '$(COMMIT)' > $@

OPTIONAL := $(MICROHTTPD) $(MESHOPTIMIZER) $(LCMS2) $(UTF8PROC) $(EXPAT)
$B/optional: FORCE
	@mkdir -p $(@D)
	@echo '$(OPTIONAL)' | cmp -s - $@ || echo '$(OPTIONAL)' > $@

# The table of test groups is made from the test files; a new file needs only its prototype in
# tests.h.
GROUP := s/^int test_group_\([a-z0-9_]*\)(void)$$
$B/test_groups.c: FORCE
	@mkdir -p $(@D)
	@{ echo '/* Generated from the test_*.c in tests/ by make. */'; \
	   echo '#include <stddef.h>'; \
	   echo '#include "tests.h"'; \
	   echo 'const test_group test_groups[] = {'; \
	   sed -n '$(GROUP)/    {"\1", test_group_\1},/p' $(TEST_SRC); \
	   echo '    {NULL, NULL}};'; } > $@.new
	@if cmp -s $@.new $@; then rm $@.new; else mv $@.new $@; fi

GENERATED := kernels_embed pages_embed test_groups
$(GENERATED:%=$B/obj/%.o): $B/obj/%.o: $B/%.c
	@mkdir -p $(@D)
	$(call SAY,CC $<)$(CC) $(CFLAGS_ALL) -c $< -o $@

help:
	@sed -n '/^#/!q; s/^# \{0,1\}//p' Makefile

deps:
	@tests/deps.sh build

demo:
	@tests/deps.sh build
	@$(MAKE) --no-print-directory build/cl-nascent build/make-scene
	@tests/demo.sh

check: test

# make's name for scripts: a recipe with $(MAKE) would run them in a dry run, too
SELF := $(MAKE)

test test-all:
	@tests/deps.sh build test lint
	@MAKE="$(SELF)" tests/all.sh $(if $(filter test-all,$@),all)

test-devices grind:
	@tests/deps.sh build test
	@$(MAKE) --no-print-directory build/cl-nascent build/make-scene build/json-query \
	    build/device-cases build/tests
	@tests/device/devices.sh $(if $(filter grind,$@),grind)

faults:
	@tests/deps.sh build
	@$(MAKE) --no-print-directory build/cl-nascent build/make-scene build/json-query \
	    build/faults.so
	@FAULTS=$(or $(FAULTS),50) tests/faults.sh $(SECTIONS)

fuzz:
	@tests/deps.sh build test fuzz
	@$(MAKE) --no-print-directory B=build/fuzz CC=$(CLANG) OPT="-O1 -g" \
	    SANITIZE=address,undefined,fuzzer-no-link build/fuzz/fuzz
	@tests/fuzz/fuzz.sh $(or $(SECONDS),600) $(TARGETS)

test-browser:
	@tests/deps.sh build test browser
	@$(MAKE) --no-print-directory build/cl-nascent build/make-scene build/json-query
	@tests/browser/browser.sh

lint:
	@tests/deps.sh build test lint
	@tests/lint.sh

fmt:
	@tests/deps.sh lint
	$(CLANG_FORMAT) -i $(ALL_SRC) $(EXAMPLES) \
	    $(wildcard host/*/*.h include/*.h tests/*/*.h bench/*/*.h data/*.h)

bench: bench-programs
	build/bench-kernels --results bench/results $(BENCH)

bench-sort:
	@tests/deps.sh build peers
	@$(MAKE) --no-print-directory build/bench-sort
	build/bench-sort $(BENCH)

bench-scale:
	@tests/deps.sh build
	@$(MAKE) --no-print-directory bench-scale-programs
	bench/scale/scale.sh build/bench-scale $(BENCH)

# Only what is trained is built with MPI.
bench-scale-programs:
	@$(MAKE) --no-print-directory MPI= build/make-scene
	@$(MAKE) --no-print-directory MPI=1 build/mpi/cl-nascent build/mpi/bench-scale

bench-programs:
	@tests/deps.sh build
	@$(MAKE) --no-print-directory build/cl-nascent build/make-scene build/json-query \
	    build/bench-kernels build/bench-table build/bench-views build/bench-growth \
	    build/bench-floaters

TEXTS := README.md ARCHITECTURE.md CONTRIBUTING.md CHANGELOG.md CITATION.cff LICENSE

# Quoted, as the folders may have spaces.
install: all
	install -d "$(DESTDIR)$(BINDIR)" "$(DESTDIR)$(INCLUDEDIR)" "$(DESTDIR)$(LIBDIR)/pkgconfig" \
	    "$(DESTDIR)$(DATADIR)/cl-nascent/tune" "$(DESTDIR)$(MANDIR)/man1" \
	    "$(DESTDIR)$(DOCDIR)/examples" "$(DESTDIR)$(DOCDIR)/docs"
	install -m 755 $P/cl-nascent "$(DESTDIR)$(BINDIR)/"
	install -m 644 include/cl_nascent.h "$(DESTDIR)$(INCLUDEDIR)/"
	install -m 644 $P/public/libcl-nascent.a "$(DESTDIR)$(LIBDIR)/"
	install -m 755 $P/$(SONAME) "$(DESTDIR)$(LIBDIR)/"
	ln -sf $(SONAME) "$(DESTDIR)$(LIBDIR)/libcl-nascent.so"
	install -m 644 $P/cl-nascent.pc "$(DESTDIR)$(LIBDIR)/pkgconfig/"
	install -m 644 $(TUNE_ROWS) "$(DESTDIR)$(DATADIR)/cl-nascent/tune/"
	install -m 644 docs/cl-nascent.1 $P/texts/*.1 "$(DESTDIR)$(MANDIR)/man1/"
	install -m 644 $(TEXTS) "$(DESTDIR)$(DOCDIR)/"
	install -m 644 docs/*.md docs/*.png docs/*.jpg "$(DESTDIR)$(DOCDIR)/docs/"
	install -m 644 $(EXAMPLES) "$(DESTDIR)$(DOCDIR)/examples/"
	install -d "$(DESTDIR)$(BASHDIR)" "$(DESTDIR)$(ZSHDIR)" "$(DESTDIR)$(FISHDIR)"
	install -m 644 $P/texts/completion.bash "$(DESTDIR)$(BASHDIR)/cl-nascent"
	install -m 644 $P/texts/completion.zsh "$(DESTDIR)$(ZSHDIR)/_cl-nascent"
	install -m 644 $P/texts/completion.fish "$(DESTDIR)$(FISHDIR)/cl-nascent.fish"

# The same variables as for install. Folders that are empty then go, up to PREFIX, but none that
# systems have anyway.
FOLDERS = "$(DESTDIR)$(BINDIR)" "$(DESTDIR)$(INCLUDEDIR)" "$(DESTDIR)$(LIBDIR)/pkgconfig" \
          "$(DESTDIR)$(LIBDIR)" "$(DESTDIR)$(MANDIR)/man1" "$(DESTDIR)$(MANDIR)" \
          "$(DESTDIR)$(DOCDIR)" "$(DESTDIR)$(BASHDIR)" "$(DESTDIR)$(ZSHDIR)" \
          "$(DESTDIR)$(FISHDIR)" "$(DESTDIR)$(DATADIR)"
uninstall:
	rm -f "$(DESTDIR)$(BINDIR)/cl-nascent" "$(DESTDIR)$(INCLUDEDIR)/cl_nascent.h" \
	    "$(DESTDIR)$(LIBDIR)/libcl-nascent.a" "$(DESTDIR)$(LIBDIR)/$(SONAME)" \
	    "$(DESTDIR)$(LIBDIR)/libcl-nascent.so" "$(DESTDIR)$(LIBDIR)/pkgconfig/cl-nascent.pc" \
	    "$(DESTDIR)$(MANDIR)/man1/cl-nascent.1" "$(DESTDIR)$(MANDIR)/man1/cl-nascent-"*.1 \
	    "$(DESTDIR)$(BASHDIR)/cl-nascent" "$(DESTDIR)$(ZSHDIR)/_cl-nascent" \
	    "$(DESTDIR)$(FISHDIR)/cl-nascent.fish" $(TEXTS:%="$(DESTDIR)$(DOCDIR)/%")
	rm -rf "$(DESTDIR)$(DATADIR)/cl-nascent" "$(DESTDIR)$(DOCDIR)/docs" \
	    "$(DESTDIR)$(DOCDIR)/examples"
	@for folder in $(FOLDERS); do \
	   while :; do \
	     case $$folder in \
	     /usr | /usr/local | /usr/local/bin | /usr/local/include | /usr/local/lib | \
	     /usr/local/share | /usr/local/share/man | /usr/local/man | /opt | "") break ;; \
	     esac; \
	     rmdir "$$folder" 2>/dev/null || break; \
	     folder=$${folder%/*}; \
	     case $$folder in \
	     "$(DESTDIR)$(PREFIX)" | "$(DESTDIR)$(PREFIX)"/*) ;; \
	     *) break ;; \
	     esac; \
	   done; \
	 done

# Of git alone: what is not committed is left out.
DIST := cl-nascent-$(VERSION)
dist:
	@mkdir -p build
	git archive --prefix=$(DIST)/ -o build/$(DIST).tar HEAD
	xz -f build/$(DIST).tar

deb: all
	@MAKE="$(SELF)" packaging/deb.sh

clean: # B=FOLDER: that one alone
	rm -rf "$(if $(filter command,$(firstword $(origin B))),$B,build)"

-include $(ALL_SRC:%.c=$B/obj/%.d) $B/obj/mpi/ranks.d
.DELETE_ON_ERROR:
FORCE:
.PHONY: all FORCE help deps demo test test-all \
        check test-devices test-browser grind faults fuzz lint fmt \
        bench bench-programs bench-peers bench-sort bench-scale bench-scale-programs \
        install uninstall dist deb clean
