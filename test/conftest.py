import os

# Before any test module imports rclpy or matplotlib; subprocesses inherit it. Stale shared-memory
# segments of killed processes would make endpoints match without data, hence UDP.
os.environ['FASTDDS_BUILTIN_TRANSPORTS'] = 'UDPv4'
os.environ['ROS_AUTOMATIC_DISCOVERY_RANGE'] = 'LOCALHOST'
os.environ['ROS_DOMAIN_ID'] = str(1 + os.getpid() % 100)
os.environ['MPLBACKEND'] = 'Agg'
