#pragma once
// The page has one object of some classes; JavaScript's answers find it here.
namespace client {

/// A base of the class T. Main thread only.
template <class T>
class OnlyOne {
 public:
  OnlyOne(const OnlyOne&) = delete;
  OnlyOne& operator=(const OnlyOne&) = delete;
  /// Null before there is one.
  static T* instance() { return instance_; }

 protected:
  OnlyOne() { instance_ = static_cast<T*>(this); }
  ~OnlyOne() { instance_ = nullptr; }

 private:
  static inline T* instance_ = nullptr;
};

}  // namespace client
