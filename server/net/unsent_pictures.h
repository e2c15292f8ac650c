#pragma once
// The pictures of /render that were drawn and that their visitors have not taken yet: they lie in memory as long as a
// visitor reads slowly. Only the io thread uses this.
#include <cstddef>
#include <map>
#include <string>

namespace server {

/// An address holds as many as its limit says (PictureLimits), whatever their size. So that a few large ones of one
/// address do not keep others from theirs, each address counts with its share of the room at most.
class UnsentPictures {
 public:
  static constexpr std::size_t kRoom = std::size_t{256} << 20;  ///< bytes of all; beyond, no new one is begun
  static constexpr std::size_t kShare = kRoom / 4;              ///< of one address

  /// `address`: a limitKey(), here and below.
  std::size_t countOf(const std::string& address) const;
  bool hasRoom() const { return counted_ < kRoom; }

 private:
  friend class UnsentPicture;
  void add(const std::string& address, std::size_t bytes);
  void remove(const std::string& address, std::size_t bytes);

  struct OfAddress {
    std::size_t count = 0, bytes = 0;
  };
  std::map<std::string, OfAddress> of_;
  std::size_t counted_ = 0;
};

/// Counts one picture as long as it lives.
class UnsentPicture {
 public:
  UnsentPicture(UnsentPictures& all, std::string address, std::size_t bytes);
  ~UnsentPicture();
  UnsentPicture(const UnsentPicture&) = delete;
  UnsentPicture& operator=(const UnsentPicture&) = delete;

 private:
  UnsentPictures& all_;
  const std::string address_;
  const std::size_t bytes_;
};

}  // namespace server
