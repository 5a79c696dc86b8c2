// A list whose elements stay where they are while it grows: references last until the list is compacted.
// Copying copies the elements. Stage: tic.
#pragma once

#include <cstddef>
#include <memory>
#include <vector>

namespace comrad::doom {

template <typename T, std::size_t kBlockSize = 64>
class StableList {
 public:
  StableList() = default;
  StableList(StableList&&) noexcept = default;
  StableList& operator=(StableList&&) noexcept = default;
  StableList(const StableList& other) { *this = other; }
  StableList& operator=(const StableList& other) {
    if (this == &other) return *this;
    reserve(other.size_);
    for (std::size_t i = 0; i < other.size_; ++i) at(i) = other[i];
    size_ = other.size_;
    return *this;
  }

  std::size_t size() const { return size_; }
  bool empty() const { return size_ == 0; }
  T& operator[](std::size_t index) { return at(index); }
  const T& operator[](std::size_t index) const { return blocks_[index / kBlockSize][index % kBlockSize]; }
  T& back() { return at(size_ - 1); }
  void reserve(std::size_t count) {
    while (blocks_.size() * kBlockSize < count) blocks_.push_back(std::make_unique<T[]>(kBlockSize));
  }
  T& push_back(T value) {
    reserve(size_ + 1);
    return at(size_++) = std::move(value);
  }
  /// One element more, with whatever it held when it was last in the list: its memory is used again.
  T& extend() {
    reserve(size_ + 1);
    return at(size_++);
  }
  void pop_back() { --size_; }
  void resize_down(std::size_t count) { size_ = count; }  ///< forgets the elements from `count` on
  void clear() { size_ = 0; }

  template <typename List, typename Value>
  class Iterator {
   public:
    Iterator(List* list, std::size_t index) : list_(list), index_(index) {}
    Value& operator*() const { return (*list_)[index_]; }
    Value* operator->() const { return &(*list_)[index_]; }
    Iterator& operator++() { return ++index_, *this; }
    bool operator!=(const Iterator& other) const { return index_ != other.index_; }
    bool operator==(const Iterator& other) const { return index_ == other.index_; }

   private:
    List* list_;
    std::size_t index_;
  };
  auto begin() { return Iterator<StableList, T>(this, 0); }
  auto end() { return Iterator<StableList, T>(this, size_); }
  auto begin() const { return Iterator<const StableList, const T>(this, 0); }
  auto end() const { return Iterator<const StableList, const T>(this, size_); }

 private:
  T& at(std::size_t index) { return blocks_[index / kBlockSize][index % kBlockSize]; }

  std::vector<std::unique_ptr<T[]>> blocks_;
  std::size_t size_ = 0;
};

}  // namespace comrad::doom
