#!/usr/bin/env python3
"""NOTICE names the libraries that the programs link, no more and no less.

usage: check_notice.py SOURCE PROGRAM...

Shared libraries are those that the programs' dynamic sections name; static ones and headers are found by the sources'
includes. The page has no such section: the walls let it link nothing but glm, and Emscripten brings the rest.
"""
import re
import subprocess
import sys
from pathlib import Path

# Names in NOTICE by the beginning of a shared library's name.
LIBRARIES = {
    "libEGL": "libglvnd",
    "libGLESv2": "libglvnd",
    "libOpenMesh": "OpenMesh",
    "libavcodec": "FFmpeg",
    "libavutil": "FFmpeg",
    "libboost": "Boost",
    "libcrypto": "OpenSSL",
    "libcurl": "libcurl",
    "libdraco": "Draco",
    "libfmt": "{fmt}",
    "libgmp": "GMP",
    "libglfw": "GLFW",
    "libjpeg": "libjpeg-turbo",
    "liblmdb": "LMDB",
    "libmeshoptimizer": "meshoptimizer",
    "libmetis": "METIS",
    "libopencv": "OpenCV",
    "libpng": "libpng",
    "libspdlog": "spdlog",
    "libssl": "OpenSSL",
    "libstb": "stb",
    "libswscale": "FFmpeg",
    "libturbojpeg": "libjpeg-turbo",
    "libwebp": "libwebp",
    "libz.": "zlib",
}
# The C library and the compiler's, which NOTICE names together.
SYSTEM = ("libc.so", "libm.so", "libgcc_s.so", "libstdc++.so", "ld-linux", "libasan", "libubsan", "libtsan")

# Names in NOTICE by the beginning of an include.
HEADERS = {
    "boost/": "Boost",
    "CGAL/": "CGAL",
    "CLI/": "CLI11",
    "draco/": "Draco",
    "glm/": "GLM",
    "imgui": "Dear ImGui",
    "lmdb.h": "LMDB",
    "meshoptimizer.h": "meshoptimizer",
    "metis.h": "METIS",
    "nlohmann/": "nlohmann-json",
    "OpenMesh/": "OpenMesh",
    "spdlog/": "spdlog",
}
# Their code is in a shared library, by whose name they are found.
SHARED_HEADERS = ("curl/", "EGL/", "GLES3/", "GLFW/", "jpeglib.h", "libavcodec/", "libavutil/", "libswscale/",
                  "opencv2/", "openssl/", "png.h", "turbojpeg.h", "webp/", "zlib.h")
# The C++ library's and the system's, by Linux and Emscripten.
SYSTEM_HEADERS = ("linux/", "netinet/", "sys/", "arpa/", "net/", "emscripten")

ROOMS = "base mesh lod repository protocol plan server client compare".split()


def linked_by(program):
    section = subprocess.run(["readelf", "-d", program], capture_output=True, text=True, check=True).stdout
    for soname in re.findall(r"\(NEEDED\).*\[(.*)\]", section):
        if soname.startswith(SYSTEM):
            continue
        names = [name for stem, name in LIBRARIES.items() if soname.startswith(stem)]
        yield names[0] if names else f"a library that this check does not know ({soname} of {program})"


def included_by(source):
    pattern = re.compile(r'^\s*#include [<"]([^>"]+)[>"]', re.MULTILINE)
    for room in ROOMS:
        for path in (source / room).rglob("*"):
            if path.suffix not in (".h", ".cpp"):
                continue
            for include in pattern.findall(path.read_text()):
                names = [name for stem, name in HEADERS.items() if include.startswith(stem)]
                if names:
                    yield names[0]
                elif is_foreign(include, source, path):
                    yield f"a library that this check does not know (<{include}> in {path})"


def is_foreign(include, source, path):
    """Whether a header is neither ours, nor the system's, nor one of a shared library."""
    if include.startswith(SHARED_HEADERS + SYSTEM_HEADERS):
        return False
    ours = (source / include).exists() or (path.parent / include).exists() or include.endswith("shaders.h")
    # Headers of the C and C++ libraries lie in no folder of their own.
    return not ours and "/" in include


def named_in(notice):
    text = " ".join(notice.split())
    listed = re.search(r"as Debian ships them: (.*?\)\.) ", text)
    if not listed:
        sys.exit("NOTICE has no list after \"as Debian ships them:\"")
    names = set(re.findall(r"(?:^|, )([^,()]+) \([^()]*\)", listed[1]))
    if "FFmpeg's libavcodec" in text:
        names.add("FFmpeg")
    if "CGAL's 3D triangulation" in text:
        names.update(("CGAL", "GMP"))
    return names


def main():
    source = Path(sys.argv[1])
    notice = (source / "NOTICE").read_text()
    linked = {name for program in sys.argv[2:] for name in linked_by(program)} | set(included_by(source))
    named = named_in(notice)
    for name in sorted(linked - named):
        print(f"NOTICE does not name {name}, which is linked")
    for name in sorted(named - linked):
        print(f"NOTICE names {name}, which no program links")
    page = "The page" in notice and "Emscripten" in notice
    if not page:
        print("NOTICE does not say what the page holds")
    ports = re.findall(r"-sUSE_(?!ES6)\w+|--use-port\S*", (source / "client/web/CMakeLists.txt").read_text())
    for port in ports:
        print(f"NOTICE does not name the library that the page gets by {port}")
    return 1 if linked != named or not page or ports else 0


sys.exit(main())
