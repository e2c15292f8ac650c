#include "base/guard/guarded_read.h"

#include <setjmp.h>  // sigsetjmp is POSIX
#include <signal.h>

#include <atomic>
#include <cstring>
#include <mutex>

namespace base {
namespace {

// A fault in this thread jumps here; null outside of guards. Volatile, as only a signal reads it while a body runs.
thread_local sigjmp_buf* volatile innermost = nullptr;
struct sigaction previous {};

void onFault(int signal, siginfo_t* info, void* context) {
  // A fault of this thread has a code above 0; below are signals that some process sent.
  if (info->si_code > 0 && innermost != nullptr) siglongjmp(*innermost, 1);
  if ((previous.sa_flags & SA_SIGINFO) != 0) return previous.sa_sigaction(signal, info, context);
  if (previous.sa_handler == SIG_IGN && info->si_code <= 0) return;
  if (previous.sa_handler != SIG_IGN && previous.sa_handler != SIG_DFL) return previous.sa_handler(signal);
  // A faulting instruction runs again after the return and ends the process; a signal that was sent is sent again.
  struct sigaction standard {};
  standard.sa_handler = SIG_DFL;
  ::sigaction(signal, &standard, nullptr);
  if (info->si_code <= 0) ::raise(signal);
}

void installHandler() {
  struct sigaction action {};
  action.sa_sigaction = onFault;
  // The signal is not blocked while its handler runs, so a jump out of it need not restore the mask, which would cost
  // every guard a system call.
  action.sa_flags = SA_SIGINFO | SA_NODEFER;
  ::sigaction(SIGBUS, &action, &previous);
}

}  // namespace

bool runGuarded(void (*body)(void*), void* context) {
  static std::once_flag installed;
  std::call_once(installed, installHandler);
  sigjmp_buf here;
  sigjmp_buf* const outer = innermost;
  if (sigsetjmp(here, 0) != 0) {
    innermost = outer;
    return false;
  }
  innermost = &here;
  std::atomic_signal_fence(std::memory_order_seq_cst);  // the body's reads stay between the two
  body(context);
  std::atomic_signal_fence(std::memory_order_seq_cst);
  innermost = outer;
  return true;
}

bool copyGuarded(ByteView mapped, std::uint8_t* out) {
  if (mapped.empty()) return true;
  return guardedRead([&] { std::memcpy(out, mapped.data(), mapped.size()); });
}

void leaveGuard() {
  if (innermost != nullptr) siglongjmp(*innermost, 1);
}

}  // namespace base
