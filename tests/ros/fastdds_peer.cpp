// A ROS 2 program on Fast DDS, as rmw_fastrtps_cpp talks: names, types, QoS, user data; no ROS.
//
// Arguments: domain, and "subnet" (what ROS 2 does unasked), "localhost" (what
// ROS_AUTOMATIC_DISCOVERY_RANGE=LOCALHOST does) or "localhost-only" (ROS_LOCALHOST_ONLY=1). Reads one JSON command per line, answers each
// with one JSON line. Messages are read and written with Fast CDR.

#include <cstdint>
#include <cstdio>
#include <deque>
#include <iostream>
#include <map>
#include <mutex>
#include <sstream>
#include <string>
#include <vector>

#include <fastcdr/Cdr.h>
#include <fastdds/dds/domain/DomainParticipant.hpp>
#include <fastdds/dds/domain/DomainParticipantFactory.hpp>
#include <fastdds/dds/domain/DomainParticipantListener.hpp>
#include <fastdds/dds/publisher/DataWriter.hpp>
#include <fastdds/dds/publisher/Publisher.hpp>
#include <fastdds/dds/subscriber/DataReader.hpp>
#include <fastdds/dds/subscriber/SampleInfo.hpp>
#include <fastdds/dds/subscriber/Subscriber.hpp>
#include <fastdds/dds/topic/TopicDataType.hpp>
#include <fastdds/dds/topic/TypeSupport.hpp>
#include <fastdds/rtps/transport/UDPv4TransportDescriptor.h>
#include <fastrtps/utils/IPLocator.h>

using namespace eprosima::fastdds::dds;
using eprosima::fastcdr::Cdr;
using eprosima::fastcdr::FastBuffer;
using eprosima::fastrtps::rtps::Locator_t;
using eprosima::fastrtps::rtps::SerializedPayload_t;
using Bytes = std::vector<char>;

// Messages as the bytes that they are on the wire, with their 4 bytes of encapsulation.
struct RawType : TopicDataType {
  explicit RawType(const std::string& name) {
    setName(name.c_str());
    m_typeSize = 4096;  // grows
    m_isGetKeyDefined = false;
  }
  bool serialize(void* data, SerializedPayload_t* payload) override {
    const auto& bytes = *static_cast<Bytes*>(data);
    std::copy(bytes.begin(), bytes.end(), payload->data);
    payload->length = bytes.size();
    payload->encapsulation = CDR_LE;
    return true;
  }
  // A sample that its writer replaced before all its fragments were here comes empty: a flood's.
  bool deserialize(SerializedPayload_t* payload, void* data) override {
    if (payload->length < 4) return false;
    static_cast<Bytes*>(data)->assign(payload->data, payload->data + payload->length);
    return true;
  }
  std::function<uint32_t()> getSerializedSizeProvider(void* data) override {
    return [data] { return static_cast<uint32_t>(static_cast<Bytes*>(data)->size()); };
  }
  void* createData() override { return new Bytes; }
  void deleteData(void* data) override { delete static_cast<Bytes*>(data); }
  bool getKey(void*, eprosima::fastrtps::rtps::InstanceHandle_t*, bool) override { return false; }
};

// The type hash that each writer of the domain states, by topic.
struct Discovery : DomainParticipantListener {
  std::mutex mutex;
  std::map<std::string, std::string> hashes;
  void on_publisher_discovery(
      DomainParticipant*, eprosima::fastrtps::rtps::WriterDiscoveryInfo&& info) override {
    const auto& user = info.info.m_qos.m_userData.getValue();
    const std::lock_guard<std::mutex> lock(mutex);
    hashes[info.info.topicName().to_string()] = std::string(user.begin(), user.end());
  }
};

struct Peer {
  Discovery discovery;
  DomainParticipant* participant;
  DataReader *fix, *description, *image, *nodes;
  DataWriter* cmd_vel;

  Peer(int domain, const std::string& range) {
    DomainParticipantQos qos = PARTICIPANT_QOS_DEFAULT;
    qos.name("/");
    const std::string enclave = "enclave=/;";
    qos.user_data().setValue({enclave.begin(), enclave.end()});
    auto udp = std::make_shared<eprosima::fastdds::rtps::UDPv4TransportDescriptor>();
    if (range == "localhost-only") {
      udp->interfaceWhiteList.push_back("127.0.0.1");
      qos.transport().user_transports.push_back(udp);
      qos.transport().use_builtin_transports = false;
    }
    if (range == "localhost") {
      udp->maxInitialPeersRange = 33;
      qos.transport().user_transports.push_back(udp);
      auto& builtin = qos.wire_protocol().builtin;
      builtin.metatrafficMulticastLocatorList.clear();
      builtin.metatrafficUnicastLocatorList.push_back(Locator_t());
      Locator_t peer;
      eprosima::fastrtps::rtps::IPLocator::setIPv4(peer, 127, 0, 0, 1);
      builtin.initialPeersList.push_back(peer);
    }
    auto* factory = DomainParticipantFactory::get_instance();
    participant = factory->create_participant(domain, qos, &discovery, StatusMask::none());
    fix = reader("rt/agribot/fix", "sensor_msgs::msg::dds_::NavSatFix_", false);
    image = reader("rt/agribot/camera/image_raw", "sensor_msgs::msg::dds_::Image_", false);
    description = reader("rt/robot_description", "std_msgs::msg::dds_::String_", true);
    const auto entities = "rmw_dds_common::msg::dds_::ParticipantEntitiesInfo_";
    nodes = reader("ros_discovery_info", entities, true);
    auto* made = topic("rt/agribot/cmd_vel", "geometry_msgs::msg::dds_::Twist_");
    cmd_vel = participant->create_publisher(PUBLISHER_QOS_DEFAULT)
                  ->create_datawriter(made, qos_of<DataWriterQos>(DATAWRITER_QOS_DEFAULT, false));
  }

  Topic* topic(const std::string& name, const std::string& type) {
    TypeSupport(new RawType(type)).register_type(participant);
    return participant->create_topic(name, type, TOPIC_QOS_DEFAULT);
  }

  template <class Qos>
  static Qos qos_of(Qos qos, bool latched) {
    qos.endpoint().history_memory_policy =
        eprosima::fastrtps::rtps::PREALLOCATED_WITH_REALLOC_MEMORY_MODE;
    qos.reliability().kind = RELIABLE_RELIABILITY_QOS;
    qos.durability().kind = latched ? TRANSIENT_LOCAL_DURABILITY_QOS : VOLATILE_DURABILITY_QOS;
    qos.history().depth = 10;
    return qos;
  }

  DataReader* reader(const std::string& name, const std::string& type, bool latched) {
    return participant->create_subscriber(SUBSCRIBER_QOS_DEFAULT)
        ->create_datareader(
            topic(name, type), qos_of<DataReaderQos>(DATAREADER_QOS_DEFAULT, latched));
  }

  // What `tell` writes of each message that waits, as a JSON array.
  template <class Tell>
  static std::string taken(DataReader* reader, Tell tell) {
    std::ostringstream out;
    out.precision(17);
    Bytes bytes;
    SampleInfo info;
    while (reader->take_next_sample(&bytes, &info) == ReturnCode_t::RETCODE_OK) {
      if (!info.valid_data) continue;
      FastBuffer buffer(bytes.data(), bytes.size());
      Cdr cdr(buffer, Cdr::DEFAULT_ENDIAN, Cdr::DDS_CDR);
      cdr.read_encapsulation();
      out << (out.tellp() > 0 ? "," : "");
      tell(cdr, out);
    }
    return "[" + out.str() + "]";
  }

  std::string fixes() {
    return taken(fix, [](Cdr& cdr, std::ostream& out) {
      int32_t sec;
      uint32_t nanosec;
      std::string frame;
      int8_t status;
      uint16_t service;
      double latitude, longitude, altitude, covariance[9];
      cdr >> sec >> nanosec >> frame >> status >> service >> latitude >> longitude >> altitude;
      out << '[' << sec << ',' << nanosec << ",\"" << frame << "\"," << latitude << ','
          << longitude;
      for (int i = 0; i < 9; ++i) {
        cdr >> covariance[i];
        out << (i ? "," : ",[") << covariance[i];
      }
      out << "]]";
    });
  }

  std::string images() {
    return taken(image, [](Cdr& cdr, std::ostream& out) {
      uint32_t sec, nanosec, height, width, step;
      std::string frame, encoding;
      uint8_t big_endian;
      std::vector<uint8_t> data;
      cdr >> sec >> nanosec >> frame >> height >> width >> encoding >> big_endian >> step >> data;
      uint64_t sum = 0;
      for (size_t i = 0; i < data.size(); ++i) sum += (i % 251 + 1) * data[i];
      out << '[' << height << ',' << width << ",\"" << encoding << "\"," << data.size() << ','
          << sum << ']';
    });
  }

  std::string descriptions() {
    return taken(description, [](Cdr& cdr, std::ostream& out) {
      std::string text;
      cdr >> text;
      out << '"' << text << '"';
    });
  }

  std::string node_names() {
    return taken(nodes, [](Cdr& cdr, std::ostream& out) {
      uint8_t gid[16];
      uint32_t count;
      cdr.deserializeArray(gid, 16);
      cdr >> count;
      for (uint32_t i = 0; i < count; ++i) {
        std::string space, name;
        uint32_t readers, writers;
        cdr >> space >> name >> readers;
        for (uint32_t k = 0; k < readers; ++k) cdr.deserializeArray(gid, 16);
        cdr >> writers;
        for (uint32_t k = 0; k < writers; ++k) cdr.deserializeArray(gid, 16);
        out << (i ? "," : "") << "[\"" << name << "\"," << readers << ',' << writers << ']';
      }
    });
  }

  std::string hashes() {
    const std::lock_guard<std::mutex> lock(discovery.mutex);
    std::ostringstream out;
    for (const auto& [name, hash] : discovery.hashes) {
      out << (out.tellp() > 0 ? "," : "") << '"' << name << "\":\"" << hash << '"';
    }
    return "{" + out.str() + "}";
  }

  std::string twist(double v_mps, double yaw_rate_radps) {
    Bytes bytes(4 + 6 * sizeof(double));
    FastBuffer buffer(bytes.data(), bytes.size());
    Cdr cdr(buffer, Cdr::DEFAULT_ENDIAN, Cdr::DDS_CDR);
    cdr.serialize_encapsulation();
    cdr << v_mps << 0.0 << 0.0 << 0.0 << 0.0 << yaw_rate_radps;
    cmd_vel->write(&bytes);
    PublicationMatchedStatus matched;
    cmd_vel->get_publication_matched_status(matched);
    return std::to_string(matched.current_count);
  }

  // A client of a service begins with the writer of its requests.
  std::string client() {
    auto* made = topic("rq/agribot/pauseRequest", "std_srvs::srv::dds_::SetBool_Request_");
    participant->create_publisher(PUBLISHER_QOS_DEFAULT)
        ->create_datawriter(made, qos_of<DataWriterQos>(DATAWRITER_QOS_DEFAULT, false));
    return "null";
  }

  std::string answer(const std::string& line) {
    double v_mps = 0.0, yaw_rate_radps = 0.0;
    if (std::sscanf(line.c_str(), "[\"twist\", %lf, %lf]", &v_mps, &yaw_rate_radps) == 2) {
      return twist(v_mps, yaw_rate_radps);
    }
    if (line == "[\"fixes\"]") return fixes();
    if (line == "[\"images\"]") return images();
    if (line == "[\"descriptions\"]") return descriptions();
    if (line == "[\"node_names\"]") return node_names();
    if (line == "[\"hashes\"]") return hashes();
    if (line == "[\"client\"]") return client();
    return "null";
  }
};

int main(int count, char** arguments) {
  if (count != 3) return 2;
  Peer peer(std::stoi(arguments[1]), arguments[2]);
  std::cout << "\"ready\"" << std::endl;
  for (std::string line; std::getline(std::cin, line);) {
    std::cout << peer.answer(line) << std::endl;  // which flushes
  }
}
