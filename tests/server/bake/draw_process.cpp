// This process draws for draw_processes_test.
//
//   draw_process [MARK N]      ends by SIGKILL at its N-th face (0: the first) if it could make the file MARK; "-" as
//                              MARK: every time
#include <fcntl.h>
#include <signal.h>
#include <unistd.h>

#include <cstdlib>
#include <string>

#include "server/bake/draw_processes.h"

int main(int argc, char** argv) {
  const std::string mark = argc > 2 ? argv[1] : "";
  int left = argc > 2 ? std::atoi(argv[2]) : 0;
  return server::runDrawProcess(STDIN_FILENO, [&](const base::Image& rgba, const server::FaceCoding& coding) {
    if (!mark.empty() && left-- == 0 &&
        (mark == "-" || ::open(mark.c_str(), O_CREAT | O_EXCL | O_WRONLY | O_CLOEXEC, 0644) >= 0))
      ::kill(::getpid(), SIGKILL);
    return server::encodeFace(rgba, coding);
  });
}
