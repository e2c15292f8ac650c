#pragma once
// Several processes draw and encode faces, each with a GL context of its own. With software GL that keeps all cores
// busy, which one context does not: it sets up vertices and triangles on the thread that draws. Contexts of one process
// would do as well, but Mesa's llvmpipe (22.3) crashes in its own code about twice in a hundred bakes when several draw
// at a time. A process that dies (by a crash, or because the kernel is out of memory) is started again
// (docs/decisions/software-gl-processes.md).
#include <memory>
#include <string>
#include <vector>

#include "server/bake/face_maker.h"

namespace server {

/// Serves the bake at the other end of `socket` until that closes. The program that `command` below starts calls it
/// with its standard input. Returns the exit status.
int runDrawProcess(int socket, const Encode& encode = encodeFace);

/// `command`: a program and its arguments; it gets the socket as its standard input, and its standard output goes to
/// standard error. `processes`: 1 at least.
std::unique_ptr<FaceMaker> makeProcessFaceMaker(const FaceWork& work, const std::vector<std::string>& command,
                                                unsigned processes, FaceMaker::OnFace on_face,
                                                FaceMaker::OnError on_error);

/// How many processes keep `threads` cores busy, where there is the memory (draw_memory.h): at most 16.
unsigned drawProcessesFor(unsigned threads);

}  // namespace server
