// Thin RAII over Cyclone DDS's C interface: entities, QoS, typed writers and readers. Setup throws
// config::ConfigError. World: jobs only (dds_write allocates and locks). Included by the daemon's
// service, by drivers/dds and by tests. QoS and names: facts about ROS 2's wire (rt/<name>,
// pkg::msg::dds_::Name_, XCDR1, no keys, never KEEP_ALL).
#pragma once
#include <dds/dds.h>

#include <algorithm>
#include <memory>
#include <string>
#include <string_view>
#include <utility>

#include "core/config/config.hpp"

namespace wb::dds {

template <class T>
const dds_topic_descriptor_t* descriptor();

// Declares a type that is a topic: wb::dds::msg::Name, and its descriptor. At namespace wb::dds.
#define WB_DDS_TOPIC_TYPE(package, Name)                         \
  namespace msg {                                                \
  using Name = package##_msg_dds__##Name##_;                     \
  }                                                              \
  template <>                                                    \
  inline const dds_topic_descriptor_t* descriptor<msg::Name>() { \
    return &package##_msg_dds__##Name##__desc;                   \
  }

// Owns one entity; deleting it deletes its children too.
class Entity {
 public:
  Entity() = default;
  Entity(dds_entity_t entity, const std::string& what) : entity_(entity) {
    if (entity < 0) {
      throw config::ConfigError("DDS: " + what + ": " + dds_strretcode(-entity) +
                                " (check CYCLONEDDS_URI and the network interface it names)");
    }
  }
  Entity(Entity&& other) noexcept : entity_(std::exchange(other.entity_, 0)) {}
  Entity& operator=(Entity&& other) noexcept {
    std::swap(entity_, other.entity_);
    return *this;
  }
  ~Entity() {
    if (entity_ > 0) dds_delete(entity_);
  }
  dds_entity_t get() const { return entity_; }

 private:
  dds_entity_t entity_ = 0;
};

struct Profile {
  bool reliable = true;
  bool latched = false;  // late readers get the last `depth` samples
  int depth = 1;
};

using Qos = std::unique_ptr<dds_qos_t, void (*)(dds_qos_t*)>;

inline Qos make_qos(const Profile& profile) {
  Qos qos(dds_create_qos(), dds_delete_qos);
  dds_qset_reliability(qos.get(),
                       profile.reliable ? DDS_RELIABILITY_RELIABLE : DDS_RELIABILITY_BEST_EFFORT,
                       DDS_INFINITY);
  dds_qset_history(qos.get(), DDS_HISTORY_KEEP_LAST, profile.depth);
  if (profile.latched) {
    dds_qset_durability(qos.get(), DDS_DURABILITY_TRANSIENT_LOCAL);
    // What Cyclone keeps for late readers is bounded by the durability service, not by the history.
    dds_qset_durability_service(qos.get(), 0, DDS_HISTORY_KEEP_LAST, profile.depth, -1, -1, -1);
  }
  dds_qset_writer_data_lifecycle(qos.get(), false);
  const dds_data_representation_id_t representation = DDS_DATA_REPRESENTATION_XCDR1;
  dds_qset_data_representation(qos.get(), 1, &representation);
  return qos;
}

inline Entity make_participant(int domain, const std::string& name) {
  Qos qos(dds_create_qos(), dds_delete_qos);
  dds_qset_entity_name(qos.get(), name.c_str());
  return Entity(dds_create_participant(static_cast<dds_domainid_t>(domain), qos.get(), nullptr),
                "participant in domain " + std::to_string(domain));
}

// Without QoS of its own: a participant may have several endpoints on one topic, each with its QoS.
template <class T>
Entity make_topic(const Entity& participant, const std::string& name) {
  return Entity(
      dds_create_topic(participant.get(), descriptor<T>(), name.c_str(), nullptr, nullptr),
      "topic " + name);
}

template <class T>
class Writer {
 public:
  Writer(const Entity& participant, const std::string& topic, const Profile& profile) {
    const Qos qos = make_qos(profile);
    topic_ = make_topic<T>(participant, topic);
    writer_ = Entity(dds_create_writer(participant.get(), topic_.get(), qos.get(), nullptr),
                     "writer of " + topic);
  }
  // False if Cyclone would not take it; the sample is then lost.
  bool write(const T& message) const {
    return dds_write(writer_.get(), &message) == DDS_RETCODE_OK;
  }
  bool matched() const { return dds_get_matched_subscriptions(writer_.get(), nullptr, 0) > 0; }

 private:
  Entity topic_;
  Entity writer_;
};

template <class T>
class Reader {
 public:
  Reader(const Entity& participant, const std::string& topic, const Profile& profile) {
    const Qos qos = make_qos(profile);
    topic_ = make_topic<T>(participant, topic);
    reader_ = Entity(dds_create_reader(participant.get(), topic_.get(), qos.get(), nullptr),
                     "reader of " + topic);
    condition_ = Entity(dds_create_readcondition(reader_.get(), DDS_ANY_STATE),
                        "read condition of " + topic);
  }
  // Hands every waiting sample to `handle(const T&)`, oldest first; the samples are Cyclone's and
  // go back to it.
  template <class Handle>
  void take(Handle&& handle) {
    for (;;) {
      void* sample = nullptr;
      dds_sample_info_t info;
      if (dds_take(reader_.get(), &sample, &info, 1, 1) != 1) return;
      const std::unique_ptr<void, Return> loan(sample, Return{reader_.get()});
      if (info.valid_data) handle(*static_cast<const T*>(sample));
    }
  }
  bool matched() const { return dds_get_matched_publications(reader_.get(), nullptr, 0) > 0; }
  dds_entity_t condition() const { return condition_.get(); }  // true while samples wait
  // Calls back on a thread of Cyclone's when samples have come, which must do no more than wake
  // somebody.
  void on_data(dds_on_data_available_fn wake, void* argument) {
    const std::unique_ptr<dds_listener_t, void (*)(dds_listener_t*)> listener(
        dds_create_listener(argument), dds_delete_listener);
    dds_lset_data_available(listener.get(), wake);
    dds_set_listener(reader_.get(), listener.get());
  }

 private:
  struct Return {
    dds_entity_t reader;
    void operator()(void* sample) const { dds_return_loan(reader, &sample, 1); }
  };
  Entity topic_;
  Entity reader_;
  Entity condition_;
};

class Waitset {
 public:
  explicit Waitset(const Entity& participant)
      : waitset_(dds_create_waitset(participant.get()), "waitset") {}
  void attach(dds_entity_t condition) { dds_waitset_attach(waitset_.get(), condition, 0); }
  // Returns when an attached condition is true, at the latest after the time-out.
  void wait(std::int64_t timeout_ns) {
    dds_waitset_wait(waitset_.get(), nullptr, 0, std::max<std::int64_t>(timeout_ns, 0));
  }

 private:
  Entity waitset_;
};

// Copies into a bounded string of a message, truncating.
template <std::size_t N>
void copy_text(char (&to)[N], std::string_view from) {
  const std::size_t length = std::min(from.size(), N - 1);
  std::copy_n(from.begin(), length, to);
  to[length] = '\0';
}

// Cyclone never writes through a sample's pointers when it sends, but its C structs are not const.
inline char* text(const char* s) { return const_cast<char*>(s); }

// Makes a message's sequence a view of `items`, which must outlive the write.
template <class Sequence, class Items>
void view(Sequence& sequence, Items& items, std::size_t count) {
  sequence._maximum = sequence._length = static_cast<std::uint32_t>(count);
  sequence._buffer = count ? items.data() : nullptr;
  sequence._release = false;
}

}  // namespace wb::dds
