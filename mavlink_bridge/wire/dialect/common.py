"""Messages of MAVLink's common dialect, and numbers of some of its enumerations.

`make dialect` writes this file from pymavlink's common.xml (MIT licence): do not edit it. Each row:
id, name, extra byte of the checksum, format of the payload, fields in the order of the standard,
fields in the order of the wire, number of extension fields.
"""

GPS_FIX_TYPE_NO_GPS = 0
GPS_FIX_TYPE_NO_FIX = 1
GPS_FIX_TYPE_2D_FIX = 2
GPS_FIX_TYPE_3D_FIX = 3
GPS_FIX_TYPE_DGPS = 4
GPS_FIX_TYPE_RTK_FLOAT = 5
GPS_FIX_TYPE_RTK_FIXED = 6
GPS_FIX_TYPE_STATIC = 7
GPS_FIX_TYPE_PPP = 8
GPS_INPUT_IGNORE_FLAG_ALT = 1
GPS_INPUT_IGNORE_FLAG_HDOP = 2
GPS_INPUT_IGNORE_FLAG_VDOP = 4
GPS_INPUT_IGNORE_FLAG_VEL_HORIZ = 8
GPS_INPUT_IGNORE_FLAG_VEL_VERT = 16
GPS_INPUT_IGNORE_FLAG_SPEED_ACCURACY = 32
GPS_INPUT_IGNORE_FLAG_HORIZONTAL_ACCURACY = 64
GPS_INPUT_IGNORE_FLAG_VERTICAL_ACCURACY = 128
MAV_BATTERY_FUNCTION_UNKNOWN = 0
MAV_BATTERY_FUNCTION_ALL = 1
MAV_BATTERY_FUNCTION_PROPULSION = 2
MAV_BATTERY_FUNCTION_AVIONICS = 3
MAV_BATTERY_FUNCTION_PAYLOAD = 4
MAV_BATTERY_TYPE_UNKNOWN = 0
MAV_BATTERY_TYPE_LIPO = 1
MAV_BATTERY_TYPE_LIFE = 2
MAV_BATTERY_TYPE_LION = 3
MAV_BATTERY_TYPE_NIMH = 4
MAV_FRAME_GLOBAL = 0
MAV_FRAME_LOCAL_NED = 1
MAV_FRAME_MISSION = 2
MAV_FRAME_GLOBAL_RELATIVE_ALT = 3
MAV_FRAME_LOCAL_ENU = 4
MAV_FRAME_GLOBAL_INT = 5
MAV_FRAME_GLOBAL_RELATIVE_ALT_INT = 6
MAV_FRAME_LOCAL_OFFSET_NED = 7
MAV_FRAME_BODY_NED = 8
MAV_FRAME_BODY_OFFSET_NED = 9
MAV_FRAME_GLOBAL_TERRAIN_ALT = 10
MAV_FRAME_GLOBAL_TERRAIN_ALT_INT = 11
MAV_FRAME_BODY_FRD = 12
MAV_FRAME_RESERVED_13 = 13
MAV_FRAME_RESERVED_14 = 14
MAV_FRAME_RESERVED_15 = 15
MAV_FRAME_RESERVED_16 = 16
MAV_FRAME_RESERVED_17 = 17
MAV_FRAME_RESERVED_18 = 18
MAV_FRAME_RESERVED_19 = 19
MAV_FRAME_LOCAL_FRD = 20
MAV_FRAME_LOCAL_FLU = 21
MAV_MODE_FLAG_CUSTOM_MODE_ENABLED = 1
MAV_MODE_FLAG_TEST_ENABLED = 2
MAV_MODE_FLAG_AUTO_ENABLED = 4
MAV_MODE_FLAG_GUIDED_ENABLED = 8
MAV_MODE_FLAG_STABILIZE_ENABLED = 16
MAV_MODE_FLAG_HIL_ENABLED = 32
MAV_MODE_FLAG_MANUAL_INPUT_ENABLED = 64
MAV_MODE_FLAG_SAFETY_ARMED = 128

MESSAGES = (
    (0, 'HEARTBEAT', 50, '<IBBBBB', 'type autopilot base_mode custom_mode system_status mavlink_version', 'custom_mode type autopilot base_mode system_status mavlink_version', 0),
    (1, 'SYS_STATUS', 124, '<IIIHHhHHHHHHbIII', 'onboard_control_sensors_present onboard_control_sensors_enabled onboard_control_sensors_health load voltage_battery current_battery battery_remaining drop_rate_comm errors_comm errors_count1 errors_count2 errors_count3 errors_count4 onboard_control_sensors_present_extended onboard_control_sensors_enabled_extended onboard_control_sensors_health_extended', 'onboard_control_sensors_present onboard_control_sensors_enabled onboard_control_sensors_health load voltage_battery current_battery drop_rate_comm errors_comm errors_count1 errors_count2 errors_count3 errors_count4 battery_remaining onboard_control_sensors_present_extended onboard_control_sensors_enabled_extended onboard_control_sensors_health_extended', 3),
    (2, 'SYSTEM_TIME', 137, '<QI', 'time_unix_usec time_boot_ms', 'time_unix_usec time_boot_ms', 0),
    (4, 'PING', 237, '<QIBB', 'time_usec seq target_system target_component', 'time_usec seq target_system target_component', 0),
    (5, 'CHANGE_OPERATOR_CONTROL', 217, '<BBB25s', 'target_system control_request version passkey', 'target_system control_request version passkey', 0),
    (6, 'CHANGE_OPERATOR_CONTROL_ACK', 104, '<BBB', 'gcs_system_id control_request ack', 'gcs_system_id control_request ack', 0),
    (7, 'AUTH_KEY', 119, '<32s', 'key', 'key', 0),
    (11, 'SET_MODE', 89, '<IBB', 'target_system base_mode custom_mode', 'custom_mode target_system base_mode', 0),
    (20, 'PARAM_REQUEST_READ', 214, '<hBB16s', 'target_system target_component param_id param_index', 'param_index target_system target_component param_id', 0),
    (21, 'PARAM_REQUEST_LIST', 159, '<BB', 'target_system target_component', 'target_system target_component', 0),
    (22, 'PARAM_VALUE', 220, '<fHH16sB', 'param_id param_value param_type param_count param_index', 'param_value param_count param_index param_id param_type', 0),
    (23, 'PARAM_SET', 168, '<fBB16sB', 'target_system target_component param_id param_value param_type', 'param_value target_system target_component param_id param_type', 0),
    (24, 'GPS_RAW_INT', 24, '<QiiiHHHHBBiIIIIH', 'time_usec fix_type lat lon alt eph epv vel cog satellites_visible alt_ellipsoid h_acc v_acc vel_acc hdg_acc yaw', 'time_usec lat lon alt eph epv vel cog fix_type satellites_visible alt_ellipsoid h_acc v_acc vel_acc hdg_acc yaw', 6),
    (25, 'GPS_STATUS', 23, '<B20B20B20B20B20B', 'satellites_visible satellite_prn satellite_used satellite_elevation satellite_azimuth satellite_snr', 'satellites_visible satellite_prn satellite_used satellite_elevation satellite_azimuth satellite_snr', 0),
    (26, 'SCALED_IMU', 170, '<Ihhhhhhhhhh', 'time_boot_ms xacc yacc zacc xgyro ygyro zgyro xmag ymag zmag temperature', 'time_boot_ms xacc yacc zacc xgyro ygyro zgyro xmag ymag zmag temperature', 1),
    (27, 'RAW_IMU', 144, '<QhhhhhhhhhBh', 'time_usec xacc yacc zacc xgyro ygyro zgyro xmag ymag zmag id temperature', 'time_usec xacc yacc zacc xgyro ygyro zgyro xmag ymag zmag id temperature', 2),
    (28, 'RAW_PRESSURE', 67, '<Qhhhh', 'time_usec press_abs press_diff1 press_diff2 temperature', 'time_usec press_abs press_diff1 press_diff2 temperature', 0),
    (29, 'SCALED_PRESSURE', 115, '<Iffhh', 'time_boot_ms press_abs press_diff temperature temperature_press_diff', 'time_boot_ms press_abs press_diff temperature temperature_press_diff', 1),
    (30, 'ATTITUDE', 39, '<Iffffff', 'time_boot_ms roll pitch yaw rollspeed pitchspeed yawspeed', 'time_boot_ms roll pitch yaw rollspeed pitchspeed yawspeed', 0),
    (31, 'ATTITUDE_QUATERNION', 246, '<Ifffffff4f', 'time_boot_ms q1 q2 q3 q4 rollspeed pitchspeed yawspeed repr_offset_q', 'time_boot_ms q1 q2 q3 q4 rollspeed pitchspeed yawspeed repr_offset_q', 1),
    (32, 'LOCAL_POSITION_NED', 185, '<Iffffff', 'time_boot_ms x y z vx vy vz', 'time_boot_ms x y z vx vy vz', 0),
    (33, 'GLOBAL_POSITION_INT', 104, '<IiiiihhhH', 'time_boot_ms lat lon alt relative_alt vx vy vz hdg', 'time_boot_ms lat lon alt relative_alt vx vy vz hdg', 0),
    (34, 'RC_CHANNELS_SCALED', 237, '<IhhhhhhhhBB', 'time_boot_ms port chan1_scaled chan2_scaled chan3_scaled chan4_scaled chan5_scaled chan6_scaled chan7_scaled chan8_scaled rssi', 'time_boot_ms chan1_scaled chan2_scaled chan3_scaled chan4_scaled chan5_scaled chan6_scaled chan7_scaled chan8_scaled port rssi', 0),
    (35, 'RC_CHANNELS_RAW', 244, '<IHHHHHHHHBB', 'time_boot_ms port chan1_raw chan2_raw chan3_raw chan4_raw chan5_raw chan6_raw chan7_raw chan8_raw rssi', 'time_boot_ms chan1_raw chan2_raw chan3_raw chan4_raw chan5_raw chan6_raw chan7_raw chan8_raw port rssi', 0),
    (36, 'SERVO_OUTPUT_RAW', 222, '<IHHHHHHHHBHHHHHHHH', 'time_usec port servo1_raw servo2_raw servo3_raw servo4_raw servo5_raw servo6_raw servo7_raw servo8_raw servo9_raw servo10_raw servo11_raw servo12_raw servo13_raw servo14_raw servo15_raw servo16_raw', 'time_usec servo1_raw servo2_raw servo3_raw servo4_raw servo5_raw servo6_raw servo7_raw servo8_raw port servo9_raw servo10_raw servo11_raw servo12_raw servo13_raw servo14_raw servo15_raw servo16_raw', 8),
    (37, 'MISSION_REQUEST_PARTIAL_LIST', 212, '<hhBBB', 'target_system target_component start_index end_index mission_type', 'start_index end_index target_system target_component mission_type', 1),
    (38, 'MISSION_WRITE_PARTIAL_LIST', 9, '<hhBBB', 'target_system target_component start_index end_index mission_type', 'start_index end_index target_system target_component mission_type', 1),
    (39, 'MISSION_ITEM', 254, '<fffffffHHBBBBBB', 'target_system target_component seq frame command current autocontinue param1 param2 param3 param4 x y z mission_type', 'param1 param2 param3 param4 x y z seq command target_system target_component frame current autocontinue mission_type', 1),
    (40, 'MISSION_REQUEST', 230, '<HBBB', 'target_system target_component seq mission_type', 'seq target_system target_component mission_type', 1),
    (41, 'MISSION_SET_CURRENT', 28, '<HBB', 'target_system target_component seq', 'seq target_system target_component', 0),
    (42, 'MISSION_CURRENT', 28, '<HHBB', 'seq total mission_state mission_mode', 'seq total mission_state mission_mode', 3),
    (43, 'MISSION_REQUEST_LIST', 132, '<BBB', 'target_system target_component mission_type', 'target_system target_component mission_type', 1),
    (44, 'MISSION_COUNT', 221, '<HBBB', 'target_system target_component count mission_type', 'count target_system target_component mission_type', 1),
    (45, 'MISSION_CLEAR_ALL', 232, '<BBB', 'target_system target_component mission_type', 'target_system target_component mission_type', 1),
    (46, 'MISSION_ITEM_REACHED', 11, '<H', 'seq', 'seq', 0),
    (47, 'MISSION_ACK', 153, '<BBBB', 'target_system target_component type mission_type', 'target_system target_component type mission_type', 1),
    (48, 'SET_GPS_GLOBAL_ORIGIN', 41, '<iiiBQ', 'target_system latitude longitude altitude time_usec', 'latitude longitude altitude target_system time_usec', 1),
    (49, 'GPS_GLOBAL_ORIGIN', 39, '<iiiQ', 'latitude longitude altitude time_usec', 'latitude longitude altitude time_usec', 1),
    (50, 'PARAM_MAP_RC', 78, '<ffffhBB16sB', 'target_system target_component param_id param_index parameter_rc_channel_index param_value0 scale param_value_min param_value_max', 'param_value0 scale param_value_min param_value_max param_index target_system target_component param_id parameter_rc_channel_index', 0),
    (51, 'MISSION_REQUEST_INT', 196, '<HBBB', 'target_system target_component seq mission_type', 'seq target_system target_component mission_type', 1),
    (54, 'SAFETY_SET_ALLOWED_AREA', 15, '<ffffffBBB', 'target_system target_component frame p1x p1y p1z p2x p2y p2z', 'p1x p1y p1z p2x p2y p2z target_system target_component frame', 0),
    (55, 'SAFETY_ALLOWED_AREA', 3, '<ffffffB', 'frame p1x p1y p1z p2x p2y p2z', 'p1x p1y p1z p2x p2y p2z frame', 0),
    (61, 'ATTITUDE_QUATERNION_COV', 167, '<Q4ffff9f', 'time_usec q rollspeed pitchspeed yawspeed covariance', 'time_usec q rollspeed pitchspeed yawspeed covariance', 0),
    (62, 'NAV_CONTROLLER_OUTPUT', 183, '<fffffhhH', 'nav_roll nav_pitch nav_bearing target_bearing wp_dist alt_error aspd_error xtrack_error', 'nav_roll nav_pitch alt_error aspd_error xtrack_error nav_bearing target_bearing wp_dist', 0),
    (63, 'GLOBAL_POSITION_INT_COV', 119, '<Qiiiifff36fB', 'time_usec estimator_type lat lon alt relative_alt vx vy vz covariance', 'time_usec lat lon alt relative_alt vx vy vz covariance estimator_type', 0),
    (64, 'LOCAL_POSITION_NED_COV', 191, '<Qfffffffff45fB', 'time_usec estimator_type x y z vx vy vz ax ay az covariance', 'time_usec x y z vx vy vz ax ay az covariance estimator_type', 0),
    (65, 'RC_CHANNELS', 118, '<IHHHHHHHHHHHHHHHHHHBB', 'time_boot_ms chancount chan1_raw chan2_raw chan3_raw chan4_raw chan5_raw chan6_raw chan7_raw chan8_raw chan9_raw chan10_raw chan11_raw chan12_raw chan13_raw chan14_raw chan15_raw chan16_raw chan17_raw chan18_raw rssi', 'time_boot_ms chan1_raw chan2_raw chan3_raw chan4_raw chan5_raw chan6_raw chan7_raw chan8_raw chan9_raw chan10_raw chan11_raw chan12_raw chan13_raw chan14_raw chan15_raw chan16_raw chan17_raw chan18_raw chancount rssi', 0),
    (66, 'REQUEST_DATA_STREAM', 148, '<HBBBB', 'target_system target_component req_stream_id req_message_rate start_stop', 'req_message_rate target_system target_component req_stream_id start_stop', 0),
    (67, 'DATA_STREAM', 21, '<HBB', 'stream_id message_rate on_off', 'message_rate stream_id on_off', 0),
    (69, 'MANUAL_CONTROL', 243, '<hhhhHBHBhhhhhhhh', 'target x y z r buttons buttons2 enabled_extensions s t aux1 aux2 aux3 aux4 aux5 aux6', 'x y z r buttons target buttons2 enabled_extensions s t aux1 aux2 aux3 aux4 aux5 aux6', 10),
    (70, 'RC_CHANNELS_OVERRIDE', 124, '<HHHHHHHHBBHHHHHHHHHH', 'target_system target_component chan1_raw chan2_raw chan3_raw chan4_raw chan5_raw chan6_raw chan7_raw chan8_raw chan9_raw chan10_raw chan11_raw chan12_raw chan13_raw chan14_raw chan15_raw chan16_raw chan17_raw chan18_raw', 'chan1_raw chan2_raw chan3_raw chan4_raw chan5_raw chan6_raw chan7_raw chan8_raw target_system target_component chan9_raw chan10_raw chan11_raw chan12_raw chan13_raw chan14_raw chan15_raw chan16_raw chan17_raw chan18_raw', 10),
    (73, 'MISSION_ITEM_INT', 38, '<ffffiifHHBBBBBB', 'target_system target_component seq frame command current autocontinue param1 param2 param3 param4 x y z mission_type', 'param1 param2 param3 param4 x y z seq command target_system target_component frame current autocontinue mission_type', 1),
    (74, 'VFR_HUD', 20, '<ffffhH', 'airspeed groundspeed heading throttle alt climb', 'airspeed groundspeed alt climb heading throttle', 0),
    (75, 'COMMAND_INT', 158, '<ffffiifHBBBBB', 'target_system target_component frame command current autocontinue param1 param2 param3 param4 x y z', 'param1 param2 param3 param4 x y z command target_system target_component frame current autocontinue', 0),
    (76, 'COMMAND_LONG', 152, '<fffffffHBBB', 'target_system target_component command confirmation param1 param2 param3 param4 param5 param6 param7', 'param1 param2 param3 param4 param5 param6 param7 command target_system target_component confirmation', 0),
    (77, 'COMMAND_ACK', 143, '<HBBiBB', 'command result progress result_param2 target_system target_component', 'command result progress result_param2 target_system target_component', 4),
    (81, 'MANUAL_SETPOINT', 106, '<IffffBB', 'time_boot_ms roll pitch yaw thrust mode_switch manual_override_switch', 'time_boot_ms roll pitch yaw thrust mode_switch manual_override_switch', 0),
    (82, 'SET_ATTITUDE_TARGET', 49, '<I4fffffBBB', 'time_boot_ms target_system target_component type_mask q body_roll_rate body_pitch_rate body_yaw_rate thrust', 'time_boot_ms q body_roll_rate body_pitch_rate body_yaw_rate thrust target_system target_component type_mask', 0),
    (83, 'ATTITUDE_TARGET', 22, '<I4fffffB', 'time_boot_ms type_mask q body_roll_rate body_pitch_rate body_yaw_rate thrust', 'time_boot_ms q body_roll_rate body_pitch_rate body_yaw_rate thrust type_mask', 0),
    (84, 'SET_POSITION_TARGET_LOCAL_NED', 143, '<IfffffffffffHBBB', 'time_boot_ms target_system target_component coordinate_frame type_mask x y z vx vy vz afx afy afz yaw yaw_rate', 'time_boot_ms x y z vx vy vz afx afy afz yaw yaw_rate type_mask target_system target_component coordinate_frame', 0),
    (85, 'POSITION_TARGET_LOCAL_NED', 140, '<IfffffffffffHB', 'time_boot_ms coordinate_frame type_mask x y z vx vy vz afx afy afz yaw yaw_rate', 'time_boot_ms x y z vx vy vz afx afy afz yaw yaw_rate type_mask coordinate_frame', 0),
    (86, 'SET_POSITION_TARGET_GLOBAL_INT', 5, '<IiifffffffffHBBB', 'time_boot_ms target_system target_component coordinate_frame type_mask lat_int lon_int alt vx vy vz afx afy afz yaw yaw_rate', 'time_boot_ms lat_int lon_int alt vx vy vz afx afy afz yaw yaw_rate type_mask target_system target_component coordinate_frame', 0),
    (87, 'POSITION_TARGET_GLOBAL_INT', 150, '<IiifffffffffHB', 'time_boot_ms coordinate_frame type_mask lat_int lon_int alt vx vy vz afx afy afz yaw yaw_rate', 'time_boot_ms lat_int lon_int alt vx vy vz afx afy afz yaw yaw_rate type_mask coordinate_frame', 0),
    (89, 'LOCAL_POSITION_NED_SYSTEM_GLOBAL_OFFSET', 231, '<Iffffff', 'time_boot_ms x y z roll pitch yaw', 'time_boot_ms x y z roll pitch yaw', 0),
    (90, 'HIL_STATE', 183, '<Qffffffiiihhhhhh', 'time_usec roll pitch yaw rollspeed pitchspeed yawspeed lat lon alt vx vy vz xacc yacc zacc', 'time_usec roll pitch yaw rollspeed pitchspeed yawspeed lat lon alt vx vy vz xacc yacc zacc', 0),
    (91, 'HIL_CONTROLS', 63, '<QffffffffBB', 'time_usec roll_ailerons pitch_elevator yaw_rudder throttle aux1 aux2 aux3 aux4 mode nav_mode', 'time_usec roll_ailerons pitch_elevator yaw_rudder throttle aux1 aux2 aux3 aux4 mode nav_mode', 0),
    (92, 'HIL_RC_INPUTS_RAW', 54, '<QHHHHHHHHHHHHB', 'time_usec chan1_raw chan2_raw chan3_raw chan4_raw chan5_raw chan6_raw chan7_raw chan8_raw chan9_raw chan10_raw chan11_raw chan12_raw rssi', 'time_usec chan1_raw chan2_raw chan3_raw chan4_raw chan5_raw chan6_raw chan7_raw chan8_raw chan9_raw chan10_raw chan11_raw chan12_raw rssi', 0),
    (93, 'HIL_ACTUATOR_CONTROLS', 47, '<QQ16fB', 'time_usec controls mode flags', 'time_usec flags controls mode', 0),
    (100, 'OPTICAL_FLOW', 175, '<QfffhhBBff', 'time_usec sensor_id flow_x flow_y flow_comp_m_x flow_comp_m_y quality ground_distance flow_rate_x flow_rate_y', 'time_usec flow_comp_m_x flow_comp_m_y ground_distance flow_x flow_y sensor_id quality flow_rate_x flow_rate_y', 2),
    (101, 'GLOBAL_VISION_POSITION_ESTIMATE', 102, '<Qffffff21fB', 'usec x y z roll pitch yaw covariance reset_counter', 'usec x y z roll pitch yaw covariance reset_counter', 2),
    (102, 'VISION_POSITION_ESTIMATE', 158, '<Qffffff21fB', 'usec x y z roll pitch yaw covariance reset_counter', 'usec x y z roll pitch yaw covariance reset_counter', 2),
    (103, 'VISION_SPEED_ESTIMATE', 208, '<Qfff9fB', 'usec x y z covariance reset_counter', 'usec x y z covariance reset_counter', 2),
    (104, 'VICON_POSITION_ESTIMATE', 56, '<Qffffff21f', 'usec x y z roll pitch yaw covariance', 'usec x y z roll pitch yaw covariance', 1),
    (105, 'HIGHRES_IMU', 93, '<QfffffffffffffHB', 'time_usec xacc yacc zacc xgyro ygyro zgyro xmag ymag zmag abs_pressure diff_pressure pressure_alt temperature fields_updated id', 'time_usec xacc yacc zacc xgyro ygyro zgyro xmag ymag zmag abs_pressure diff_pressure pressure_alt temperature fields_updated id', 1),
    (106, 'OPTICAL_FLOW_RAD', 138, '<QIfffffIfhBB', 'time_usec sensor_id integration_time_us integrated_x integrated_y integrated_xgyro integrated_ygyro integrated_zgyro temperature quality time_delta_distance_us distance', 'time_usec integration_time_us integrated_x integrated_y integrated_xgyro integrated_ygyro integrated_zgyro time_delta_distance_us distance temperature sensor_id quality', 0),
    (107, 'HIL_SENSOR', 108, '<QfffffffffffffIB', 'time_usec xacc yacc zacc xgyro ygyro zgyro xmag ymag zmag abs_pressure diff_pressure pressure_alt temperature fields_updated id', 'time_usec xacc yacc zacc xgyro ygyro zgyro xmag ymag zmag abs_pressure diff_pressure pressure_alt temperature fields_updated id', 1),
    (108, 'SIM_STATE', 32, '<fffffffffffffffffffffii', 'q1 q2 q3 q4 roll pitch yaw xacc yacc zacc xgyro ygyro zgyro lat lon alt std_dev_horz std_dev_vert vn ve vd lat_int lon_int', 'q1 q2 q3 q4 roll pitch yaw xacc yacc zacc xgyro ygyro zgyro lat lon alt std_dev_horz std_dev_vert vn ve vd lat_int lon_int', 2),
    (109, 'RADIO_STATUS', 185, '<HHBBBBB', 'rssi remrssi txbuf noise remnoise rxerrors fixed', 'rxerrors fixed rssi remrssi txbuf noise remnoise', 0),
    (110, 'FILE_TRANSFER_PROTOCOL', 84, '<BBB251B', 'target_network target_system target_component payload', 'target_network target_system target_component payload', 0),
    (111, 'TIMESYNC', 34, '<qq', 'tc1 ts1', 'tc1 ts1', 0),
    (112, 'CAMERA_TRIGGER', 174, '<QI', 'time_usec seq', 'time_usec seq', 0),
    (113, 'HIL_GPS', 124, '<QiiiHHHhhhHBBBH', 'time_usec fix_type lat lon alt eph epv vel vn ve vd cog satellites_visible id yaw', 'time_usec lat lon alt eph epv vel vn ve vd cog fix_type satellites_visible id yaw', 2),
    (114, 'HIL_OPTICAL_FLOW', 237, '<QIfffffIfhBB', 'time_usec sensor_id integration_time_us integrated_x integrated_y integrated_xgyro integrated_ygyro integrated_zgyro temperature quality time_delta_distance_us distance', 'time_usec integration_time_us integrated_x integrated_y integrated_xgyro integrated_ygyro integrated_zgyro time_delta_distance_us distance temperature sensor_id quality', 0),
    (115, 'HIL_STATE_QUATERNION', 4, '<Q4ffffiiihhhHHhhh', 'time_usec attitude_quaternion rollspeed pitchspeed yawspeed lat lon alt vx vy vz ind_airspeed true_airspeed xacc yacc zacc', 'time_usec attitude_quaternion rollspeed pitchspeed yawspeed lat lon alt vx vy vz ind_airspeed true_airspeed xacc yacc zacc', 0),
    (116, 'SCALED_IMU2', 76, '<Ihhhhhhhhhh', 'time_boot_ms xacc yacc zacc xgyro ygyro zgyro xmag ymag zmag temperature', 'time_boot_ms xacc yacc zacc xgyro ygyro zgyro xmag ymag zmag temperature', 1),
    (117, 'LOG_REQUEST_LIST', 128, '<HHBB', 'target_system target_component start end', 'start end target_system target_component', 0),
    (118, 'LOG_ENTRY', 56, '<IIHHH', 'id num_logs last_log_num time_utc size', 'time_utc size id num_logs last_log_num', 0),
    (119, 'LOG_REQUEST_DATA', 116, '<IIHBB', 'target_system target_component id ofs count', 'ofs count id target_system target_component', 0),
    (120, 'LOG_DATA', 134, '<IHB90B', 'id ofs count data', 'ofs id count data', 0),
    (121, 'LOG_ERASE', 237, '<BB', 'target_system target_component', 'target_system target_component', 0),
    (122, 'LOG_REQUEST_END', 203, '<BB', 'target_system target_component', 'target_system target_component', 0),
    (123, 'GPS_INJECT_DATA', 250, '<BBB110B', 'target_system target_component len data', 'target_system target_component len data', 0),
    (124, 'GPS2_RAW', 87, '<QiiiIHHHHBBBHiIIII', 'time_usec fix_type lat lon alt eph epv vel cog satellites_visible dgps_numch dgps_age yaw alt_ellipsoid h_acc v_acc vel_acc hdg_acc', 'time_usec lat lon alt dgps_age eph epv vel cog fix_type satellites_visible dgps_numch yaw alt_ellipsoid h_acc v_acc vel_acc hdg_acc', 6),
    (125, 'POWER_STATUS', 203, '<HHH', 'Vcc Vservo flags', 'Vcc Vservo flags', 0),
    (126, 'SERIAL_CONTROL', 220, '<IHBBB70B', 'device flags timeout baudrate count data', 'baudrate timeout device flags count data', 0),
    (127, 'GPS_RTK', 25, '<IIiiiIiHBBBBB', 'time_last_baseline_ms rtk_receiver_id wn tow rtk_health rtk_rate nsats baseline_coords_type baseline_a_mm baseline_b_mm baseline_c_mm accuracy iar_num_hypotheses', 'time_last_baseline_ms tow baseline_a_mm baseline_b_mm baseline_c_mm accuracy iar_num_hypotheses wn rtk_receiver_id rtk_health rtk_rate nsats baseline_coords_type', 0),
    (128, 'GPS2_RTK', 226, '<IIiiiIiHBBBBB', 'time_last_baseline_ms rtk_receiver_id wn tow rtk_health rtk_rate nsats baseline_coords_type baseline_a_mm baseline_b_mm baseline_c_mm accuracy iar_num_hypotheses', 'time_last_baseline_ms tow baseline_a_mm baseline_b_mm baseline_c_mm accuracy iar_num_hypotheses wn rtk_receiver_id rtk_health rtk_rate nsats baseline_coords_type', 0),
    (129, 'SCALED_IMU3', 46, '<Ihhhhhhhhhh', 'time_boot_ms xacc yacc zacc xgyro ygyro zgyro xmag ymag zmag temperature', 'time_boot_ms xacc yacc zacc xgyro ygyro zgyro xmag ymag zmag temperature', 1),
    (130, 'DATA_TRANSMISSION_HANDSHAKE', 29, '<IHHHBBB', 'type size width height packets payload jpg_quality', 'size width height packets type payload jpg_quality', 0),
    (131, 'ENCAPSULATED_DATA', 223, '<H253B', 'seqnr data', 'seqnr data', 0),
    (132, 'DISTANCE_SENSOR', 85, '<IHHHBBBBff4fB', 'time_boot_ms min_distance max_distance current_distance type id orientation covariance horizontal_fov vertical_fov quaternion signal_quality', 'time_boot_ms min_distance max_distance current_distance type id orientation covariance horizontal_fov vertical_fov quaternion signal_quality', 4),
    (133, 'TERRAIN_REQUEST', 6, '<QiiH', 'lat lon grid_spacing mask', 'mask lat lon grid_spacing', 0),
    (134, 'TERRAIN_DATA', 229, '<iiH16hB', 'lat lon grid_spacing gridbit data', 'lat lon grid_spacing data gridbit', 0),
    (135, 'TERRAIN_CHECK', 203, '<ii', 'lat lon', 'lat lon', 0),
    (136, 'TERRAIN_REPORT', 1, '<iiffHHH', 'lat lon spacing terrain_height current_height pending loaded', 'lat lon terrain_height current_height spacing pending loaded', 0),
    (137, 'SCALED_PRESSURE2', 195, '<Iffhh', 'time_boot_ms press_abs press_diff temperature temperature_press_diff', 'time_boot_ms press_abs press_diff temperature temperature_press_diff', 1),
    (138, 'ATT_POS_MOCAP', 109, '<Q4ffff21f', 'time_usec q x y z covariance', 'time_usec q x y z covariance', 1),
    (139, 'SET_ACTUATOR_CONTROL_TARGET', 168, '<Q8fBBB', 'time_usec group_mlx target_system target_component controls', 'time_usec controls group_mlx target_system target_component', 0),
    (140, 'ACTUATOR_CONTROL_TARGET', 181, '<Q8fB', 'time_usec group_mlx controls', 'time_usec controls group_mlx', 0),
    (141, 'ALTITUDE', 47, '<Qffffff', 'time_usec altitude_monotonic altitude_amsl altitude_local altitude_relative altitude_terrain bottom_clearance', 'time_usec altitude_monotonic altitude_amsl altitude_local altitude_relative altitude_terrain bottom_clearance', 0),
    (142, 'RESOURCE_REQUEST', 72, '<BB120BB120B', 'request_id uri_type uri transfer_type storage', 'request_id uri_type uri transfer_type storage', 0),
    (143, 'SCALED_PRESSURE3', 131, '<Iffhh', 'time_boot_ms press_abs press_diff temperature temperature_press_diff', 'time_boot_ms press_abs press_diff temperature temperature_press_diff', 1),
    (144, 'FOLLOW_TARGET', 127, '<QQiif3f3f4f3f3fB', 'timestamp est_capabilities lat lon alt vel acc attitude_q rates position_cov custom_state', 'timestamp custom_state lat lon alt vel acc attitude_q rates position_cov est_capabilities', 0),
    (146, 'CONTROL_SYSTEM_STATE', 103, '<Qffffffffff3f3f4ffff', 'time_usec x_acc y_acc z_acc x_vel y_vel z_vel x_pos y_pos z_pos airspeed vel_variance pos_variance q roll_rate pitch_rate yaw_rate', 'time_usec x_acc y_acc z_acc x_vel y_vel z_vel x_pos y_pos z_pos airspeed vel_variance pos_variance q roll_rate pitch_rate yaw_rate', 0),
    (147, 'BATTERY_STATUS', 154, '<iih10HhBBBbiB4HBI', 'id battery_function type temperature voltages current_battery current_consumed energy_consumed battery_remaining time_remaining charge_state voltages_ext mode fault_bitmask', 'current_consumed energy_consumed temperature voltages current_battery id battery_function type battery_remaining time_remaining charge_state voltages_ext mode fault_bitmask', 5),
    (148, 'AUTOPILOT_VERSION', 178, '<QQIIIIHH8B8B8B18B', 'capabilities flight_sw_version middleware_sw_version os_sw_version board_version flight_custom_version middleware_custom_version os_custom_version vendor_id product_id uid uid2', 'capabilities uid flight_sw_version middleware_sw_version os_sw_version board_version vendor_id product_id flight_custom_version middleware_custom_version os_custom_version uid2', 1),
    (149, 'LANDING_TARGET', 200, '<QfffffBBfff4fBB', 'time_usec target_num frame angle_x angle_y distance size_x size_y x y z q type position_valid', 'time_usec angle_x angle_y distance size_x size_y target_num frame x y z q type position_valid', 6),
    (162, 'FENCE_STATUS', 189, '<IHBBB', 'breach_status breach_count breach_type breach_time breach_mitigation', 'breach_time breach_count breach_status breach_type breach_mitigation', 1),
    (192, 'MAG_CAL_REPORT', 36, '<ffffffffffBBBBfBBf', 'compass_id cal_mask cal_status autosaved fitness ofs_x ofs_y ofs_z diag_x diag_y diag_z offdiag_x offdiag_y offdiag_z orientation_confidence old_orientation new_orientation scale_factor', 'fitness ofs_x ofs_y ofs_z diag_x diag_y diag_z offdiag_x offdiag_y offdiag_z compass_id cal_mask cal_status autosaved orientation_confidence old_orientation new_orientation scale_factor', 4),
    (225, 'EFI_STATUS', 208, '<ffffffffffffffffBff', 'health ecu_index rpm fuel_consumed fuel_flow engine_load throttle_position spark_dwell_time barometric_pressure intake_manifold_pressure intake_manifold_temperature cylinder_head_temperature ignition_timing injection_time exhaust_gas_temperature throttle_out pt_compensation ignition_voltage fuel_pressure', 'ecu_index rpm fuel_consumed fuel_flow engine_load throttle_position spark_dwell_time barometric_pressure intake_manifold_pressure intake_manifold_temperature cylinder_head_temperature ignition_timing injection_time exhaust_gas_temperature throttle_out pt_compensation health ignition_voltage fuel_pressure', 2),
    (230, 'ESTIMATOR_STATUS', 163, '<QffffffffH', 'time_usec flags vel_ratio pos_horiz_ratio pos_vert_ratio mag_ratio hagl_ratio tas_ratio pos_horiz_accuracy pos_vert_accuracy', 'time_usec vel_ratio pos_horiz_ratio pos_vert_ratio mag_ratio hagl_ratio tas_ratio pos_horiz_accuracy pos_vert_accuracy flags', 0),
    (231, 'WIND_COV', 105, '<Qffffffff', 'time_usec wind_x wind_y wind_z var_horiz var_vert wind_alt horiz_accuracy vert_accuracy', 'time_usec wind_x wind_y wind_z var_horiz var_vert wind_alt horiz_accuracy vert_accuracy', 0),
    (232, 'GPS_INPUT', 151, '<QIiifffffffffHHBBBH', 'time_usec gps_id ignore_flags time_week_ms time_week fix_type lat lon alt hdop vdop vn ve vd speed_accuracy horiz_accuracy vert_accuracy satellites_visible yaw', 'time_usec time_week_ms lat lon alt hdop vdop vn ve vd speed_accuracy horiz_accuracy vert_accuracy ignore_flags time_week gps_id fix_type satellites_visible yaw', 1),
    (233, 'GPS_RTCM_DATA', 35, '<BB180B', 'flags len data', 'flags len data', 0),
    (234, 'HIGH_LATENCY', 150, '<IiihhHhhhHBBbBBBbBBBbbBB', 'base_mode custom_mode landed_state roll pitch heading throttle heading_sp latitude longitude altitude_amsl altitude_sp airspeed airspeed_sp groundspeed climb_rate gps_nsat gps_fix_type battery_remaining temperature temperature_air failsafe wp_num wp_distance', 'custom_mode latitude longitude roll pitch heading heading_sp altitude_amsl altitude_sp wp_distance base_mode landed_state throttle airspeed airspeed_sp groundspeed climb_rate gps_nsat gps_fix_type battery_remaining temperature temperature_air failsafe wp_num', 0),
    (235, 'HIGH_LATENCY2', 179, '<IiiHhhHHHBBBBBBBBBBBBbbbbbb', 'timestamp type autopilot custom_mode latitude longitude altitude target_altitude heading target_heading target_distance throttle airspeed airspeed_sp groundspeed windspeed wind_heading eph epv temperature_air climb_rate battery wp_num failure_flags custom0 custom1 custom2', 'timestamp latitude longitude custom_mode altitude target_altitude target_distance wp_num failure_flags type autopilot heading target_heading throttle airspeed airspeed_sp groundspeed windspeed wind_heading eph epv temperature_air climb_rate battery custom0 custom1 custom2', 0),
    (241, 'VIBRATION', 90, '<QfffIII', 'time_usec vibration_x vibration_y vibration_z clipping_0 clipping_1 clipping_2', 'time_usec vibration_x vibration_y vibration_z clipping_0 clipping_1 clipping_2', 0),
    (242, 'HOME_POSITION', 104, '<iiifff4ffffQ', 'latitude longitude altitude x y z q approach_x approach_y approach_z time_usec', 'latitude longitude altitude x y z q approach_x approach_y approach_z time_usec', 1),
    (243, 'SET_HOME_POSITION', 85, '<iiifff4ffffBQ', 'target_system latitude longitude altitude x y z q approach_x approach_y approach_z time_usec', 'latitude longitude altitude x y z q approach_x approach_y approach_z target_system time_usec', 1),
    (244, 'MESSAGE_INTERVAL', 95, '<iH', 'message_id interval_us', 'interval_us message_id', 0),
    (245, 'EXTENDED_SYS_STATE', 130, '<BB', 'vtol_state landed_state', 'vtol_state landed_state', 0),
    (246, 'ADSB_VEHICLE', 184, '<IiiiHHhHHB9sBB', 'ICAO_address lat lon altitude_type altitude heading hor_velocity ver_velocity callsign emitter_type tslc flags squawk', 'ICAO_address lat lon altitude heading hor_velocity ver_velocity flags squawk altitude_type callsign emitter_type tslc', 0),
    (247, 'COLLISION', 81, '<IfffBBB', 'src id action threat_level time_to_minimum_delta altitude_minimum_delta horizontal_minimum_delta', 'id time_to_minimum_delta altitude_minimum_delta horizontal_minimum_delta src action threat_level', 0),
    (248, 'V2_EXTENSION', 8, '<HBBB249B', 'target_network target_system target_component message_type payload', 'message_type target_network target_system target_component payload', 0),
    (249, 'MEMORY_VECT', 204, '<HBB32b', 'address ver type value', 'address ver type value', 0),
    (250, 'DEBUG_VECT', 49, '<Qfff10s', 'name time_usec x y z', 'time_usec x y z name', 0),
    (251, 'NAMED_VALUE_FLOAT', 170, '<If10s', 'time_boot_ms name value', 'time_boot_ms value name', 0),
    (252, 'NAMED_VALUE_INT', 44, '<Ii10s', 'time_boot_ms name value', 'time_boot_ms value name', 0),
    (253, 'STATUSTEXT', 83, '<B50sHB', 'severity text id chunk_seq', 'severity text id chunk_seq', 2),
    (254, 'DEBUG', 46, '<IfB', 'time_boot_ms ind value', 'time_boot_ms value ind', 0),
    (256, 'SETUP_SIGNING', 71, '<QBB32B', 'target_system target_component secret_key initial_timestamp', 'initial_timestamp target_system target_component secret_key', 0),
    (257, 'BUTTON_CHANGE', 131, '<IIB', 'time_boot_ms last_change_ms state', 'time_boot_ms last_change_ms state', 0),
    (258, 'PLAY_TUNE', 187, '<BB30s200s', 'target_system target_component tune tune2', 'target_system target_component tune tune2', 1),
    (259, 'CAMERA_INFORMATION', 92, '<IIfffIHHH32B32BB140sBB', 'time_boot_ms vendor_name model_name firmware_version focal_length sensor_size_h sensor_size_v resolution_h resolution_v lens_id flags cam_definition_version cam_definition_uri gimbal_device_id camera_device_id', 'time_boot_ms firmware_version focal_length sensor_size_h sensor_size_v flags resolution_h resolution_v cam_definition_version vendor_name model_name lens_id cam_definition_uri gimbal_device_id camera_device_id', 2),
    (260, 'CAMERA_SETTINGS', 146, '<IBffB', 'time_boot_ms mode_id zoomLevel focusLevel camera_device_id', 'time_boot_ms mode_id zoomLevel focusLevel camera_device_id', 3),
    (261, 'STORAGE_INFORMATION', 179, '<IfffffBBBB32sB', 'time_boot_ms storage_id storage_count status total_capacity used_capacity available_capacity read_speed write_speed type name storage_usage', 'time_boot_ms total_capacity used_capacity available_capacity read_speed write_speed storage_id storage_count status type name storage_usage', 3),
    (262, 'CAMERA_CAPTURE_STATUS', 12, '<IfIfBBiB', 'time_boot_ms image_status video_status image_interval recording_time_ms available_capacity image_count camera_device_id', 'time_boot_ms image_interval recording_time_ms available_capacity image_status video_status image_count camera_device_id', 2),
    (263, 'CAMERA_IMAGE_CAPTURED', 133, '<QIiiii4fiBb205s', 'time_boot_ms time_utc camera_id lat lon alt relative_alt q image_index capture_result file_url', 'time_utc time_boot_ms lat lon alt relative_alt q image_index camera_id capture_result file_url', 0),
    (264, 'FLIGHT_INFORMATION', 49, '<QQQII', 'time_boot_ms arming_time_utc takeoff_time_utc flight_uuid landing_time', 'arming_time_utc takeoff_time_utc flight_uuid time_boot_ms landing_time', 1),
    (265, 'MOUNT_ORIENTATION', 26, '<Iffff', 'time_boot_ms roll pitch yaw yaw_absolute', 'time_boot_ms roll pitch yaw yaw_absolute', 1),
    (266, 'LOGGING_DATA', 193, '<HBBBB249B', 'target_system target_component sequence length first_message_offset data', 'sequence target_system target_component length first_message_offset data', 0),
    (267, 'LOGGING_DATA_ACKED', 35, '<HBBBB249B', 'target_system target_component sequence length first_message_offset data', 'sequence target_system target_component length first_message_offset data', 0),
    (268, 'LOGGING_ACK', 14, '<HBB', 'target_system target_component sequence', 'sequence target_system target_component', 0),
    (269, 'VIDEO_STREAM_INFORMATION', 109, '<fIHHHHHBBB32s160sBB', 'stream_id count type flags framerate resolution_h resolution_v bitrate rotation hfov name uri encoding camera_device_id', 'framerate bitrate flags resolution_h resolution_v rotation hfov stream_id count type name uri encoding camera_device_id', 2),
    (270, 'VIDEO_STREAM_STATUS', 59, '<fIHHHHHBB', 'stream_id flags framerate resolution_h resolution_v bitrate rotation hfov camera_device_id', 'framerate bitrate flags resolution_h resolution_v rotation hfov stream_id camera_device_id', 1),
    (271, 'CAMERA_FOV_STATUS', 22, '<Iiiiiii4fffB', 'time_boot_ms lat_camera lon_camera alt_camera lat_image lon_image alt_image q hfov vfov camera_device_id', 'time_boot_ms lat_camera lon_camera alt_camera lat_image lon_image alt_image q hfov vfov camera_device_id', 1),
    (275, 'CAMERA_TRACKING_IMAGE_STATUS', 126, '<fffffffBBBB', 'tracking_status tracking_mode target_data point_x point_y radius rec_top_x rec_top_y rec_bottom_x rec_bottom_y camera_device_id', 'point_x point_y radius rec_top_x rec_top_y rec_bottom_x rec_bottom_y tracking_status tracking_mode target_data camera_device_id', 1),
    (276, 'CAMERA_TRACKING_GEO_STATUS', 18, '<iiffffffffffBB', 'tracking_status lat lon alt h_acc v_acc vel_n vel_e vel_d vel_acc dist hdg hdg_acc camera_device_id', 'lat lon alt h_acc v_acc vel_n vel_e vel_d vel_acc dist hdg hdg_acc tracking_status camera_device_id', 1),
    (277, 'CAMERA_THERMAL_RANGE', 62, '<IffffffBB', 'time_boot_ms stream_id camera_device_id max max_point_x max_point_y min min_point_x min_point_y', 'time_boot_ms max max_point_x max_point_y min min_point_x min_point_y stream_id camera_device_id', 0),
    (280, 'GIMBAL_MANAGER_INFORMATION', 70, '<IIffffffB', 'time_boot_ms cap_flags gimbal_device_id roll_min roll_max pitch_min pitch_max yaw_min yaw_max', 'time_boot_ms cap_flags roll_min roll_max pitch_min pitch_max yaw_min yaw_max gimbal_device_id', 0),
    (281, 'GIMBAL_MANAGER_STATUS', 48, '<IIBBBBB', 'time_boot_ms flags gimbal_device_id primary_control_sysid primary_control_compid secondary_control_sysid secondary_control_compid', 'time_boot_ms flags gimbal_device_id primary_control_sysid primary_control_compid secondary_control_sysid secondary_control_compid', 0),
    (282, 'GIMBAL_MANAGER_SET_ATTITUDE', 123, '<I4ffffBBB', 'target_system target_component flags gimbal_device_id q angular_velocity_x angular_velocity_y angular_velocity_z', 'flags q angular_velocity_x angular_velocity_y angular_velocity_z target_system target_component gimbal_device_id', 0),
    (283, 'GIMBAL_DEVICE_INFORMATION', 74, '<QIIIffffffHH32s32s32sBI', 'time_boot_ms vendor_name model_name custom_name firmware_version hardware_version uid cap_flags custom_cap_flags roll_min roll_max pitch_min pitch_max yaw_min yaw_max gimbal_device_id cap_flags2', 'uid time_boot_ms firmware_version hardware_version roll_min roll_max pitch_min pitch_max yaw_min yaw_max cap_flags custom_cap_flags vendor_name model_name custom_name gimbal_device_id cap_flags2', 2),
    (284, 'GIMBAL_DEVICE_SET_ATTITUDE', 99, '<4ffffHBB', 'target_system target_component flags q angular_velocity_x angular_velocity_y angular_velocity_z', 'q angular_velocity_x angular_velocity_y angular_velocity_z flags target_system target_component', 0),
    (285, 'GIMBAL_DEVICE_ATTITUDE_STATUS', 137, '<I4ffffIHBBffB', 'target_system target_component time_boot_ms flags q angular_velocity_x angular_velocity_y angular_velocity_z failure_flags delta_yaw delta_yaw_velocity gimbal_device_id', 'time_boot_ms q angular_velocity_x angular_velocity_y angular_velocity_z failure_flags flags target_system target_component delta_yaw delta_yaw_velocity gimbal_device_id', 3),
    (286, 'AUTOPILOT_STATE_FOR_GIMBAL_DEVICE', 210, '<Q4fIfffIfHBBBf', 'target_system target_component time_boot_us q q_estimated_delay_us vx vy vz v_estimated_delay_us feed_forward_angular_velocity_z estimator_status landed_state angular_velocity_z', 'time_boot_us q q_estimated_delay_us vx vy vz v_estimated_delay_us feed_forward_angular_velocity_z estimator_status target_system target_component landed_state angular_velocity_z', 1),
    (287, 'GIMBAL_MANAGER_SET_PITCHYAW', 1, '<IffffBBB', 'target_system target_component flags gimbal_device_id pitch yaw pitch_rate yaw_rate', 'flags pitch yaw pitch_rate yaw_rate target_system target_component gimbal_device_id', 0),
    (288, 'GIMBAL_MANAGER_SET_MANUAL_CONTROL', 20, '<IffffBBB', 'target_system target_component flags gimbal_device_id pitch yaw pitch_rate yaw_rate', 'flags pitch yaw pitch_rate yaw_rate target_system target_component gimbal_device_id', 0),
    (295, 'AIRSPEED', 234, '<ffhBB', 'id airspeed temperature raw_press flags', 'airspeed raw_press temperature id flags', 0),
    (296, 'GLOBAL_POSITION_SENSOR', 158, '<QIiiffffBBBBB', 'target_system target_component id time_usec processing_time source flags lat lon alt_ellipsoid alt eph epv', 'time_usec processing_time lat lon alt_ellipsoid alt eph epv target_system target_component id source flags', 0),
    (299, 'WIFI_CONFIG_AP', 19, '<32s64s', 'ssid password', 'ssid password', 0),
    (301, 'AIS_VESSEL', 243, '<IiiHHHHHHHbBBBB7s20s', 'MMSI lat lon COG heading velocity turn_rate navigational_status type dimension_bow dimension_stern dimension_port dimension_starboard callsign name tslc flags', 'MMSI lat lon COG heading velocity dimension_bow dimension_stern tslc flags turn_rate navigational_status type dimension_port dimension_starboard callsign name', 0),
    (310, 'UAVCAN_NODE_STATUS', 28, '<QIHBBB', 'time_usec uptime_sec health mode sub_mode vendor_specific_status_code', 'time_usec uptime_sec vendor_specific_status_code health mode sub_mode', 0),
    (311, 'UAVCAN_NODE_INFO', 95, '<QII80sBB16BBB', 'time_usec uptime_sec name hw_version_major hw_version_minor hw_unique_id sw_version_major sw_version_minor sw_vcs_commit', 'time_usec uptime_sec sw_vcs_commit name hw_version_major hw_version_minor hw_unique_id sw_version_major sw_version_minor', 0),
    (320, 'PARAM_EXT_REQUEST_READ', 243, '<hBB16s', 'target_system target_component param_id param_index', 'param_index target_system target_component param_id', 0),
    (321, 'PARAM_EXT_REQUEST_LIST', 88, '<BB', 'target_system target_component', 'target_system target_component', 0),
    (322, 'PARAM_EXT_VALUE', 243, '<HH16s128sB', 'param_id param_value param_type param_count param_index', 'param_count param_index param_id param_value param_type', 0),
    (323, 'PARAM_EXT_SET', 78, '<BB16s128sB', 'target_system target_component param_id param_value param_type', 'target_system target_component param_id param_value param_type', 0),
    (324, 'PARAM_EXT_ACK', 132, '<16s128sBB', 'param_id param_value param_type param_result', 'param_id param_value param_type param_result', 0),
    (330, 'OBSTACLE_DISTANCE', 23, '<Q72HHHBBffB', 'time_usec sensor_type distances increment min_distance max_distance increment_f angle_offset frame', 'time_usec distances min_distance max_distance sensor_type increment increment_f angle_offset frame', 3),
    (331, 'ODOMETRY', 91, '<Qfff4fffffff21f21fBBBBb', 'time_usec frame_id child_frame_id x y z q vx vy vz rollspeed pitchspeed yawspeed pose_covariance velocity_covariance reset_counter estimator_type quality', 'time_usec x y z q vx vy vz rollspeed pitchspeed yawspeed pose_covariance velocity_covariance frame_id child_frame_id reset_counter estimator_type quality', 3),
    (332, 'TRAJECTORY_REPRESENTATION_WAYPOINTS', 236, '<Q5f5f5f5f5f5f5f5f5f5f5f5HB', 'time_usec valid_points pos_x pos_y pos_z vel_x vel_y vel_z acc_x acc_y acc_z pos_yaw vel_yaw command', 'time_usec pos_x pos_y pos_z vel_x vel_y vel_z acc_x acc_y acc_z pos_yaw vel_yaw command valid_points', 0),
    (333, 'TRAJECTORY_REPRESENTATION_BEZIER', 231, '<Q5f5f5f5f5fB', 'time_usec valid_points pos_x pos_y pos_z delta pos_yaw', 'time_usec pos_x pos_y pos_z delta pos_yaw valid_points', 0),
    (335, 'ISBD_LINK_STATUS', 225, '<QQHHBBBB', 'timestamp last_heartbeat failed_sessions successful_sessions signal_quality ring_pending tx_session_pending rx_session_pending', 'timestamp last_heartbeat failed_sessions successful_sessions signal_quality ring_pending tx_session_pending rx_session_pending', 0),
    (339, 'RAW_RPM', 199, '<fB', 'index frequency', 'frequency index', 0),
    (340, 'UTM_GLOBAL_POSITION', 99, '<QiiiiiiihhhHHHH18BBB', 'time uas_id lat lon alt relative_alt vx vy vz h_acc v_acc vel_acc next_lat next_lon next_alt update_rate flight_state flags', 'time lat lon alt relative_alt next_lat next_lon next_alt vx vy vz h_acc v_acc vel_acc update_rate uas_id flight_state flags', 0),
    (345, 'PARAM_ERROR', 209, '<hBB16sB', 'target_system target_component param_id param_index error', 'param_index target_system target_component param_id error', 0),
    (350, 'DEBUG_FLOAT_ARRAY', 232, '<QH10s58f', 'time_usec name array_id data', 'time_usec array_id name data', 1),
    (360, 'ORBIT_EXECUTION_STATUS', 11, '<QfiifB', 'time_usec radius frame x y z', 'time_usec radius x y z frame', 0),
    (370, 'SMART_BATTERY_INFO', 75, '<iiHHHHHBBB16s50sHBII11s', 'id battery_function type capacity_full_specification capacity_full cycle_count serial_number device_name weight discharge_minimum_voltage charging_minimum_voltage resting_minimum_voltage charging_maximum_voltage cells_in_series discharge_maximum_current discharge_maximum_burst_current manufacture_date', 'capacity_full_specification capacity_full cycle_count weight discharge_minimum_voltage charging_minimum_voltage resting_minimum_voltage id battery_function type serial_number device_name charging_maximum_voltage cells_in_series discharge_maximum_current discharge_maximum_burst_current manufacture_date', 5),
    (373, 'GENERATOR_STATUS', 117, '<QfffffIiHhh', 'status generator_speed battery_current load_current power_generated bus_voltage rectifier_temperature bat_current_setpoint generator_temperature runtime time_until_maintenance', 'status battery_current load_current power_generated bus_voltage bat_current_setpoint runtime time_until_maintenance generator_speed rectifier_temperature generator_temperature', 0),
    (375, 'ACTUATOR_OUTPUT_STATUS', 251, '<QI32f', 'time_usec active actuator', 'time_usec active actuator', 0),
    (376, 'RELAY_STATUS', 199, '<IHH', 'time_boot_ms on present', 'time_boot_ms on present', 0),
    (385, 'TUNNEL', 147, '<HBBB128B', 'target_system target_component payload_type payload_length payload', 'payload_type target_system target_component payload_length payload', 0),
    (386, 'CAN_FRAME', 132, '<IBBBB8B', 'target_system target_component bus len id data', 'id target_system target_component bus len data', 0),
    (387, 'CANFD_FRAME', 4, '<IBBBB64B', 'target_system target_component bus len id data', 'id target_system target_component bus len data', 0),
    (388, 'CAN_FILTER_MODIFY', 8, '<16HBBBBB', 'target_system target_component bus operation num_ids ids', 'ids target_system target_component bus operation num_ids', 0),
    (390, 'ONBOARD_COMPUTER_STATUS', 156, '<QIII4I4I4I6I6I6I6I6I4hB8B10B4B10Bb8bH', 'time_usec uptime type cpu_cores cpu_combined gpu_cores gpu_combined temperature_board temperature_core fan_speed ram_usage ram_total storage_type storage_usage storage_total link_type link_tx_rate link_rx_rate link_tx_max link_rx_max status_flags', 'time_usec uptime ram_usage ram_total storage_type storage_usage storage_total link_type link_tx_rate link_rx_rate link_tx_max link_rx_max fan_speed type cpu_cores cpu_combined gpu_cores gpu_combined temperature_board temperature_core status_flags', 1),
    (9000, 'WHEEL_DISTANCE', 113, '<Q16dB', 'time_usec count distance', 'time_usec distance count', 0),
    (9005, 'WINCH_STATUS', 117, '<QfffffIh', 'time_usec line_length speed tension voltage current temperature status', 'time_usec line_length speed tension voltage current status temperature', 0),
    (12900, 'OPEN_DRONE_ID_BASIC_ID', 114, '<BB20BBB20B', 'target_system target_component id_or_mac id_type ua_type uas_id', 'target_system target_component id_or_mac id_type ua_type uas_id', 0),
    (12901, 'OPEN_DRONE_ID_LOCATION', 254, '<iiffffHHhBB20BBBBBBBB', 'target_system target_component id_or_mac status direction speed_horizontal speed_vertical latitude longitude altitude_barometric altitude_geodetic height_reference height horizontal_accuracy vertical_accuracy barometer_accuracy speed_accuracy timestamp timestamp_accuracy', 'latitude longitude altitude_barometric altitude_geodetic height timestamp direction speed_horizontal speed_vertical target_system target_component id_or_mac status height_reference horizontal_accuracy vertical_accuracy barometer_accuracy speed_accuracy timestamp_accuracy', 0),
    (12902, 'OPEN_DRONE_ID_AUTHENTICATION', 140, '<IBB20BBBBB23B', 'target_system target_component id_or_mac authentication_type data_page last_page_index length timestamp authentication_data', 'timestamp target_system target_component id_or_mac authentication_type data_page last_page_index length authentication_data', 0),
    (12903, 'OPEN_DRONE_ID_SELF_ID', 249, '<BB20BB23s', 'target_system target_component id_or_mac description_type description', 'target_system target_component id_or_mac description_type description', 0),
    (12904, 'OPEN_DRONE_ID_SYSTEM', 77, '<iifffIHHBB20BBBBB', 'target_system target_component id_or_mac operator_location_type classification_type operator_latitude operator_longitude area_count area_radius area_ceiling area_floor category_eu class_eu operator_altitude_geo timestamp', 'operator_latitude operator_longitude area_ceiling area_floor operator_altitude_geo timestamp area_count area_radius target_system target_component id_or_mac operator_location_type classification_type category_eu class_eu', 0),
    (12905, 'OPEN_DRONE_ID_OPERATOR_ID', 49, '<BB20BB20s', 'target_system target_component id_or_mac operator_id_type operator_id', 'target_system target_component id_or_mac operator_id_type operator_id', 0),
    (12915, 'OPEN_DRONE_ID_MESSAGE_PACK', 94, '<BB20BBB225B', 'target_system target_component id_or_mac single_message_size msg_pack_size messages', 'target_system target_component id_or_mac single_message_size msg_pack_size messages', 0),
    (12918, 'OPEN_DRONE_ID_ARM_STATUS', 139, '<B50s', 'status error', 'status error', 0),
    (12919, 'OPEN_DRONE_ID_SYSTEM_UPDATE', 7, '<iifIBB', 'target_system target_component operator_latitude operator_longitude operator_altitude_geo timestamp', 'operator_latitude operator_longitude operator_altitude_geo timestamp target_system target_component', 0),
    (12920, 'HYGROMETER_SENSOR', 20, '<hHB', 'id temperature humidity', 'temperature humidity id', 0),
)
