"""Where each row of `docs/reference/behaviour.md` is proven: section -> row -> tests, or the folder of them.

`starting::a_silent_stream` is `tests/behaviour/test_starting.py::test_a_silent_stream`; `core/streams/gate::x` is
`tests/core/streams/test_gate.py::test_x`, `./slowed::x` is `tests/test_slowed.py::test_x`; `cells::take` is that row of the
table in `test_transitions.py`. `test_index.py` checks that all of them exist, and that no test of this folder stands outside.
"""

from __future__ import annotations

__all__ = ["INDEX"]

CLIENT = "tests/client"

VALUES = {
    "arm joint v / a / j": (
        "motions::a_speed_factor_scales_the_velocity",
        "streaming::tighter_limits_of_the_configuration_hold",
        "streaming::targets_of_any_rate_become_a_smooth_100_hz_stream",
    ),
    "pose speed": (
        "poses::a_pose_motion_arrives_within_5_mm_and_0_05_rad_for_half_a_second",
        "core/motion/motion::whatever_is_asked_the_setpoints_keep_every_limit",
        "core/streams/gate::a_pose_moves_and_turns_within_the_configured_velocities",
    ),
    "chassis": (
        "driving::bounds_of_speed_are_refused_and_tell_the_bound",
        "driving::the_chassis_follows_what_it_is_told_at_every_moment",
        "core/motion/joints/slope::no_sequence_of_wishes_breaks_a_ramp",
    ),
    "settle": (
        "motions::a_motion_settles_for_0_5_s_within_its_tolerance",
        "motions::a_motion_that_does_not_settle_is_aborted",
        "motions::a_motion_to_where_the_arm_is_held_is_reached_after_settling",
    ),
    "tracking error that aborts": (
        "robot_side::an_arm_that_does_not_follow_is_latched_after_0_3_s",
        "robot_side::a_moment_away_from_the_setpoint_is_no_tracking_error",
    ),
    "jump allowed at a chunk's first point": (
        "chunks::a_chunk_may_begin_a_tenth_of_a_radian_from_the_reference",
        "chunks::a_chunk_that_begins_farther_away_is_refused",
        "chunks::a_chunk_of_poses_may_begin_two_centimetres_from_the_reference",
        "chunks::a_chunk_of_poses_that_begins_farther_away_is_refused",
        "chunks::a_chunk_of_poses_that_runs_out_brakes_and_holds",
    ),
    "expiry of a target": (
        "streaming::a_target_without_a_successor_expires",
        "streaming::an_expiry_outside_its_bounds_is_refused",
        "driving::a_velocity_expires_and_the_chassis_comes_to_rest_on_its_ramp",
        "driving::the_lift_stops_when_its_velocity_expires_and_stays_on",
    ),
    "fresh, link": ("losing_the_link::stale_is_entered_when_the_newest_state_is_older_than_100_ms",),
    "fresh, part": ("cells::part dead", "enabling::enable_is_refused_while_an_arms_state_is_dead"),
    "`fsm_state` valid": (
        "cells::fsm dead",
        "robot_side::a_robot_whose_fsm_is_not_heard_is_held_in_pause",
        "enabling::enable_is_refused_while_fsm_state_is_not_heard",
    ),
    "`current_mode` valid": (
        "cells::mode unknown",
        "enabling::enable_is_refused_while_the_mode_is_not_known",
    ),
    "client keepalive lost": ("losing_clients::a_client_is_lost_after_250_ms_without_a_keepalive",),
    "lease free after client loss / everything down": (
        "losing_clients::a_lost_client_keeps_the_lease_for_10_s_and_the_hold_for_60_s",
        "losing_clients::a_client_lost_while_nothing_is_held_costs_only_its_lease",
    ),
    "ENABLING": (
        "enabling::an_enabling_lasts_at_most_10_s_and_says_what_was_missing",
        "enabling::an_enabling_without_steady_state_says_so_and_sends_nothing",
        "enabling::every_way_out_of_enabling_names_its_reason",
    ),
    "a start outside limits": (
        "starting::a_start_just_outside_the_limits_begins_at_the_limit_and_says_so",
        "starting::a_start_far_outside_the_limits_refuses_enable",
        "starting::an_arm_that_leaves_its_limits_before_it_is_seeded_ends_the_enabling",
        "poses::a_start_a_centimetre_beyond_the_reach_begins_at_its_end_and_says_so",
        "poses::a_start_far_beyond_the_reach_refuses_enable",
    ),
    "speed factors": (
        "motions::a_speed_factor_scales_the_velocity",
        "motions::a_slower_motion_in_mid_motion_does_not_run_away",
        "streaming::a_streams_speed_factor_scales_the_velocity",
    ),
    "own time grids": ("core/streams/grid::intervals_have_one_length_at_any_uptime",),
}

TRANSITIONS = {
    "acquire (free)": (
        "losing_clients::whoever_acquires_an_unowned_hold_goes_on_from_it",
        "losing_clients::of_two_who_acquire_at_once_one_gets_the_lease",
        "losing_clients::who_acquires_a_free_lease_gets_it_in_every_state",
    ),
    "take": ("cells::take", "losing_clients::the_owner_who_takes_what_he_owns_changes_nothing"),
    "release": ("cells::release", "stopping::disable_and_release_brake_first_and_then_pause_the_robot"),
    "disable": ("cells::disable", "stopping::disable_and_release_brake_first_and_then_pause_the_robot"),
    "enable": ("cells::enable",),
    "arm motion": ("cells::arm motion",),
    "chassis, lift command": (
        "driving::chassis_and_lift_need_no_enabled_arms",
        "driving::the_chassis_drives_while_the_arms_are_enabled_and_move",
        "driving::driving_is_refused_where_it_may_not_be",
        "driving::nothing_drives_beside_vr_or_playback",
        "driving::a_drive_that_was_ended_is_not_gone_on_with",
        "driving::a_drive_that_is_asked_for_in_the_tick_of_a_stop_begins_from_rest",
        "driving::fifty_velocities_a_second_delay_neither_a_stop_nor_a_setpoint",
    ),
    "owner's stop": (
        "cells::owner's stop",
        "stopping::only_somebody_elses_stop_latches",
        "chunks::a_stop_ends_a_chunk_and_one_that_waits",
    ),
    "other's stop": ("cells::other's stop", "stopping::only_somebody_elses_stop_latches"),
    "estop": ("cells::estop", "stopping::an_estop_sends_everything_at_once_and_latches"),
    "recover": ("cells::recover", "stopping::recover_clears_all_causes_and_changes_nothing_else"),
    "client lost": (
        "cells::client lost",
        "losing_clients::a_client_whose_token_is_gone_is_lost_at_once",
        "losing_clients::a_client_that_leaves_its_lease_is_lost_at_once",
        "losing_clients::a_client_that_leaves_its_lease_and_takes_it_at_once_was_lost",
        "losing_clients::a_lost_client_while_stopping_is_still_stopped",
    ),
    "client back < 10 s": (
        "losing_clients::a_client_that_is_back_within_10_s_ends_the_clocks",
        "losing_clients::a_keepalive_of_another_client_ends_no_clock",
    ),
    "lease free": ("losing_clients::a_lost_client_keeps_the_lease_for_10_s_and_the_hold_for_60_s",),
    "60 s": (
        "losing_clients::a_lost_client_keeps_the_lease_for_10_s_and_the_hold_for_60_s",
        "losing_clients::after_60_s_the_lift_is_off",
    ),
    "stale": ("cells::stale",),
    "fresh": (
        "losing_the_link::a_short_stall_resumes_into_holding_without_a_gap",
        "losing_the_link::after_a_long_stall_0_0_is_sent_only_when_the_robot_is_known_to_be_ours",
    ),
    "transport lost": ("cells::transport lost",),
    "FSM READY": ("cells::FSM READY", "robot_side::somebody_who_enables_a_paused_robot_is_paused"),
    "FSM 0 or 1": (
        "cells::FSM 0",
        "cells::FSM 1",
        "robot_side::an_enabled_robot_that_falls_back_while_enabling_is_paused_again",
        "robot_side::a_pause_while_stopping_is_what_was_asked_for",
        "robot_side::a_pause_that_our_1_0_undid_while_stopping_is_followed_by_0_0",
        "robot_side::a_paused_owner_can_still_go_down_when_0_0_found_no_hearing",
    ),
    "FSM ERROR": (
        "cells::FSM ERROR",
        "robot_side::an_fsm_error_sends_0_0_and_latches",
        "robot_side::an_error_that_shows_only_while_stale_is_latched_after_our_own_1_0",
    ),
    "FSM 3-6, unknown value": (
        "cells::FSM 3",
        "cells::FSM 9",
        "robot_side::a_robot_that_plays_or_is_driven_by_vr_gets_nothing",
    ),
    "fsm_state dead": (
        "cells::fsm dead",
        "losing_the_link::an_fsm_that_falls_silent_while_seeding_ends_it_with_0_0",
    ),
    "VR mode": ("cells::VR mode", "robot_side::vr_mode_gets_no_arm_frame_no_1_0_and_no_0_0"),
    "API mode again": ("losing_the_link::a_0_0_that_is_owed_is_paid_when_vr_mode_ends",),
    "one arm disabled": (
        "cells::arm disabled",
        "enabling::the_other_arm_goes_on_after_one_was_disabled",
        "enabling::an_arm_that_is_disabled_while_enabling_is_left_out",
    ),
    "no arm enabled": (
        "cells::no arm",
        "enabling::enable_needs_an_enabled_arm",
        "robot_side::the_last_arm_that_leaves_its_mode_takes_everything_down",
        "robot_side::the_last_streamed_arm_that_is_disabled_takes_everything_down",
    ),
    "one part's state dead": ("cells::part dead",),
    "tracking error": (
        "cells::tracking error",
        "starting::motion_is_refused_until_a_strayed_arm_has_been_walked_back_to",
    ),
    "foreign token or publisher": (
        "cells::foreign token",
        "others::an_announcement_stops_the_motion_and_keeps_the_hold",
        "others::a_foreign_writer_while_our_chassis_runs_stops_it_and_latches",
        "others::beside_others_no_drive_begins",
        "others::an_announcement_while_nothing_of_ours_runs_is_a_condition",
    ),
    "foreign arm or fsm data": (
        "cells::foreign data",
        "others::foreign_arm_data_ends_our_frames_in_the_next_tick",
        "others::the_motion_that_foreign_data_ended_says_so",
        "others::while_foreign_data_comes_nothing_can_begin",
        "others::somebody_else_in_a_short_stall_ends_the_hold_and_nothing_is_resumed",
    ),
    "other gateway armed": (
        "cells::other gateway",
        "others::another_armed_gateway_takes_our_frames_off_without_0_0",
        "others::beside_another_gateway_nothing_that_is_owed_is_paid",
        "others::a_new_link_claims_anew",
        "others::another_gateway_that_arms_while_our_chassis_runs_stops_it",
    ),
    "SIGTERM": (
        "cells::SIGTERM",
        "ending::sigterm_ends_in_less_than_5_s_with_0_0",
        "ending::sigterm_in_the_middle_of_a_brake_brakes_on",
        "ending::sigterm_with_slow_brakes_pauses_the_robot_in_time",
        "ending::nothing_is_accepted_any_more_once_the_end_was_asked_for",
    ),
    "daemon dead: the guard": (
        "guard::a_daemon_that_had_nothing_out_leaves_nothing_to_do",
        "guard::a_dead_daemons_arms_are_braked_and_held_for_10_s",
        "guard::a_dead_daemon_that_held_nothing_is_followed_by_0_0",
        "guard::a_daemon_that_dies_while_it_stops_is_braked_and_paused",
        "guard::a_daemon_that_dies_while_the_robot_is_not_heard_is_followed_by_0_0",
        "guard::a_daemon_that_ends_as_asked_moves_nothing",
    ),
    "suspend and resume": (
        "cells::suspend",
        "time::a_suspend_frees_the_lease_and_takes_everything_down",
        "time::a_suspend_that_finds_only_old_state_holds_nothing_either",
    ),
    "names in another order": ("cells::joint order",),
    "(the table is whole)": ("transitions::every_event_is_judged_in_every_state_or_said_to_be_impossible",),
}

STARTING = {
    "a silent stream starts": (
        "starting::a_silent_stream_starts_from_the_measured_state",
        "starting::the_robot_is_ready_before_any_setpoint_differs_from_the_echo",
        "starting::the_first_heartbeat_comes_after_the_first_setpoints",
    ),
    "a live stream goes on": (
        "starting::holding_goes_on_from_its_last_setpoint_however_often",
        "starting::a_new_owner_goes_on_from_the_last_setpoint",
        "starting::ready_goes_on_from_the_echo",
    ),
    "walk": (
        "starting::a_reference_that_lost_its_arm_walks_back_and_the_grip_is_kept",
        "starting::nothing_walks_while_the_arms_are_where_they_are_held",
        "jumping::a_held_end_effector_is_not_walked_to_one_pose",
        "starting::an_arm_far_outside_its_limits_cannot_be_walked_to",
        "starting::a_stop_ends_a_walk",
    ),
    "before seeding after any stall, reconnect or own pause": (
        "starting::seeding_demands_0_3_s_of_samples_after_a_reconnect",
        "starting::seeding_starts_anew_after_our_own_pause",
        "starting::queued_old_states_do_not_seed",
        "jumping::an_arm_that_moves_at_full_speed_through_a_stall_goes_on",
        "starting::a_pause_is_left_without_a_gap_and_from_the_measured_state",
    ),
    "a part's state comes back while the link was fresh": (
        "starting::an_arm_whose_state_comes_back_while_the_link_was_fresh_is_not_seeded",
    ),
    "gripper": (
        "gripping::no_torque_is_sent_before_the_first_setpoint_and_until_the_first_command",
        "gripping::a_command_is_at_the_robot_within_20_ms_and_goes_on_at_50_hz",
        "gripping::the_value_is_kept_while_the_robot_is_held",
        "gripping::the_grip_is_kept_through",
        "gripping::in_a_stall_at_rest_the_grip_goes_on_with_the_hold_frames",
        "gripping::it_ends_with_the_arms_stream_and_begins_without_torque",
        "gripping::a_restart_of_the_stream_within_a_second_is_a_new_start",
    ),
    "two arms in one motion, one is lost": (
        "enabling::a_motion_of_two_arms_ends_for_both_when_one_is_lost",
        "enabling::an_arm_is_lost_by_its_own_code_when_both_are_lost",
        "chunks::a_chunk_of_two_arms_of_which_one_is_lost_aborts_for_both",
    ),
    "two gateways or owners `acquire` at once": (
        "losing_clients::of_two_who_acquire_at_once_one_gets_the_lease",
        "others::the_claim_is_shown_from_the_lease_on_and_looked_at_again_before_the_first_frame",
        "others::of_two_gateways_that_acquire_at_once_the_larger_zid_yields",
        "others::a_gateway_that_comes_while_another_is_armed_claims_nothing",
        "others::a_drive_begins_when_other_gateways_have_seen_the_claim",
        "others::of_a_drive_that_lost_the_claim_nothing_ever_leaves",
        "core/others/claim::of_two_that_claim_at_once_exactly_the_smaller_one_is_confirmed",
    ),
    "`enable` when ENABLING or ACTIVE; FSM 1-2 without our 1.0": (
        "enabling::enable_succeeds_when_it_is_under_way_or_done_and_sends_nothing",
        "enabling::enable_is_refused_while_the_fsm_is_not_in_pause",
        "enabling::enable_waits_until_the_last_0_0_was_heard",
        "enabling::an_enabling_ends_when_somebody_else_enables_first",
    ),
}

STOPPING = {
    "chassis zeros, lift stop, 0.0": (
        "stopping::a_stop_is_never_refused_and_stops_chassis_and_lift_at_once",
        "stopping::0_0_is_repeated_at_20_hz_until_fsm_0_is_seen",
        "stopping::0_0_that_is_not_heard_ends_after_2_s_and_is_told_once",
        "stopping::without_transport_the_reply_says_that_the_stop_was_not_delivered",
        "stopping::an_estop_without_transport_is_sent_again_when_the_robot_is_back",
        "stopping::an_estop_that_was_heard_is_not_sent_again_after_a_later_stall",
        "stopping::an_estop_that_was_cut_short_by_a_loss_is_sent_again",
        "stopping::recover_ends_the_repetition_of_an_estop_that_was_not_heard",
        "time::a_late_tick_still_sends_stop_frames",
    ),
    "zeros on every way out": (
        "driving::zeros_leave_at_once_and_for_a_second_on_every_way_out",
        "driving::a_client_that_freezes_is_stopped_by_the_expiry_or_the_keepalive",
        "driving::a_lost_transport_is_followed_by_zeros_when_it_is_back",
        "driving::what_the_robot_has_ended_itself_in_an_outage_is_not_ended_again",
        "driving::a_late_tick_ends_the_driving",
        "driving::a_stop_leaves_before_a_drive_that_is_asked_for_in_the_same_tick",
        "driving::no_two_requests_of_one_tick_are_a_fault",
    ),
    "plain stop": (
        "stopping::a_plain_stop_does_not_send_0_0",
        "stopping::a_stop_ends_motions_and_streams_with_its_code",
        "stopping::a_model_without_a_lift_gets_no_lift_frames",
    ),
    "requests from before a stop": (
        "stopping::what_was_asked_before_a_stop_is_refused_after_it",
        "stopping::a_target_from_before_a_stop_moves_nothing",
        "stopping::a_repeated_request_gets_its_first_reply_again",
        "stopping::another_request_under_a_number_that_was_used_is_refused",
        "stopping::a_stop_stops_even_under_a_number_that_was_used_before",
    ),
    "lift": (
        "driving::the_lift_ends_with_the_servo_off",
        "driving::a_held_lift_stays_on_for_60_s_after_its_owner_is_lost",
        "driving::a_lift_in_idle_is_off_when_the_lease_of_its_lost_owner_is_free",
        "driving::in_vr_mode_the_lift_is_stopped_and_then_left_alone",
        "driving::an_unowned_lift_is_off_although_the_robot_is_not_heard_any_more",
        "driving::disabling_the_lift_takes_its_servo_off",
        "driving::a_model_without_a_lift_refuses_its_commands",
        "driving::the_lift_does_not_drive_against_an_fsm_in_error",
        "driving::a_part_that_is_switched_off_is_refused_and_stops",
        "driving::an_unknown_mode_stops_the_driving_and_refuses_it",
        "stopping::release_takes_the_lift_off_after_a_stop",
        "stopping::an_estop_sends_everything_at_once_and_latches",
        "losing_clients::after_60_s_the_lift_is_off",
        "ending::sigterm_ends_in_less_than_5_s_with_0_0",
    ),
    "estop": (
        "stopping::an_estop_sends_everything_at_once_and_latches",
        "stopping::an_estop_goes_on_when_the_robot_is_switched_to_vr_mode",
    ),
    "`recover`": (
        "stopping::recover_clears_all_causes_and_changes_nothing_else",
        "stopping::recover_clears_none_while_a_cause_persists",
        "stopping::after_recover_the_hold_goes_on_and_motion_is_allowed",
    ),
    "latches, epoch, own zid": (
        "ending::latches_survive_a_restart_of_the_daemon",
        "ending::an_epoch_is_never_reused",
        "ending::a_remembered_estop_is_sent_again_only_where_it_is_needed",
    ),
    "under another address": (
        "robot/endpoint::an_address_has_one_spelling",
        "process/recall::every_spelling_of_an_address_has_one_file",
        "process/recall::latches_of_another_address_come_with_the_router",
        "process/recall::epochs_go_on_above_those_of_every_file",
        "process/recall::what_is_cleared_here_is_cleared_there_and_not_before",
        "process/recall::a_latch_that_comes_with_the_router_is_there_before_anything_can_be_enabled",
        "e2e/heart::an_estop_survives_another_address_of_the_robot",
    ),
    "`with control()` ends normally": CLIENT,
    "a stop is its arrival": (
        "api/stop_lane::whatever_arrives_is_the_stop",
        "api/stop_lane::a_flood_of_stops_is_bounded_and_each_of_them_is_answered",
        "api/stop_lane::what_lies_in_the_inbox_keeps_no_stop_away",
        "process/loop::a_stop_is_served_at_once_between_the_instants_of_the_grid",
        "e2e/stopping::whatever_arrives_on_the_keys_of_stops_ends_motion_and_latches",
        "api/stop_pipe::what_is_written_is_the_stop",
        "api/stop_pipe::who_may_open_the_socket_may_write_and_nobody_else_reads",
        "api/stop_pipe::a_dropped_stop_ends_the_sleep_and_the_rest_of_the_loop",
        "api/stop_pipe::a_flood_of_stops_lets_the_loop_sleep",
        "guard/guard_server::what_was_dropped_beside_the_daemons_socket_is_read_while_the_guard_acts",
        "e2e/guard::an_estop_that_a_frozen_daemon_did_not_read_is_its_guards",
    ),
    "hold and cancel": ("stopping::hold_and_cancel_keep_the_lease_the_state_and_the_heartbeat",),
    '`on_loss="pause"`': ("cells::lost, pause", "losing_clients::on_loss_pause_goes_down_at_once"),
    "takeover in mid-motion": (
        "losing_clients::a_takeover_in_mid_motion_brakes_first",
        "losing_clients::a_takeover_of_a_brake_waits_for_it_too",
        "losing_clients::a_late_command_of_a_former_owner_moves_nothing",
    ),
    "`acquire` by others while the clocks run": (
        "losing_clients::while_the_clocks_run_others_take_but_do_not_acquire",
    ),
    "stale": (
        "losing_the_link::stale_is_entered_when_the_newest_state_is_older_than_100_ms",
        "losing_the_link::at_rest_constant_frames_go_on_for_at_most_0_8_s",
        "losing_the_link::the_hold_in_stale_ends_at_once_with_whatever_would_end_holding",
        "losing_the_link::a_stop_in_stale_does_not_end_the_hold",
        "losing_the_link::a_burst_after_a_stall_of_the_link_moves_nothing",
    ),
    "short stall": (
        "losing_the_link::a_short_stall_resumes_into_holding_without_a_gap",
        "losing_the_link::a_short_stall_in_motion_resumes_from_where_the_arms_are",
        "losing_the_link::a_stall_within_a_short_stall_is_one_stall",
        "losing_the_link::a_short_stall_needs_an_fsm_sample_that_came_after_it_began",
        "losing_the_link::a_short_stall_in_which_the_robot_paused_is_not_resumed",
        "losing_the_link::an_fsm_that_falls_silent_while_seeding_ends_it_with_0_0",
        "losing_the_link::an_arm_that_stays_silent_after_a_short_stall_ends_the_way_back",
        "losing_the_link::a_stall_from_pause_or_enabling_is_not_resumed",
        "losing_the_link::a_backlog_that_still_says_ready_does_not_restart_a_robot_that_was_stopped_meanwhile",
        "losing_the_link::a_1_0_that_was_wrong_after_a_short_stall_is_taken_back_at_once",
    ),
    "the last word of a long stall": (
        "losing_the_link::the_last_word_of_a_stall_that_outlives_its_time_is_0_0",
        "losing_the_link::what_is_owed_after_the_last_word_is_paid_all_the_same",
        "losing_the_link::somebody_elses_robot_gets_no_last_word",
        "losing_the_link::the_last_word_does_not_end_an_estops_repetition",
        "core/supervision/stall::a_robot_that_is_heard_again_ends_the_last_word_at_once",
        "core/streams/heartbeat::the_last_word_is_0_0_for_0_3_s_and_settles_nothing",
    ),
    "0.0 after a loss": (
        "losing_the_link::after_a_long_stall_0_0_is_sent_only_when_the_robot_is_known_to_be_ours",
        "losing_the_link::after_a_long_stall_nothing_is_sent_to_a_robot_that_is_somebody_elses",
        "losing_the_link::a_0_0_that_is_owed_is_paid_when_vr_mode_ends",
    ),
    "transport lost": (
        "losing_the_link::a_lost_transport_ends_everything_and_a_reconnect_re_arms_nothing",
        "losing_the_link::another_transport_is_a_lost_one",
        "losing_the_link::a_transport_that_is_back_in_the_same_tick_was_lost_all_the_same",
    ),
    "a wall clock is off, jumps or drifts": (
        "time::a_jump_of_the_robots_clock_changes_nothing",
        "time::enabling_works_after_a_jump_of_the_robots_clock",
        "time::a_robots_clock_that_is_off_and_drifts_changes_nothing",
        "time::enabling_knows_old_state_whatever_the_robots_clock",
        "time::a_drift_that_begins_and_ends_in_mid_motion_changes_nothing",
    ),
    "own suspend": (
        "time::a_suspend_frees_the_lease_and_takes_everything_down",
        "time::what_was_heard_before_a_sleep_is_not_believed_after_it",
    ),
    "tick late > 50 ms": (
        "time::a_tick_that_is_more_than_50_ms_late_is_skipped_and_told",
        "time::after_a_gap_in_which_the_robot_stopped_the_arms_the_motion_is_over",
        "time::after_late_ticks_that_make_such_a_gap_together_the_motion_is_over",
        "motions::a_skipped_tick_delays_a_motion_and_does_not_compress_it",
    ),
    "a vanished owner is vanished in real time": (
        "time::motion_ends_in_time_after_the_owner_vanished_though_every_tick_is_late",
        "time::what_a_vanished_owner_asked_before_a_pause_of_ours_does_not_move_after_it",
        "time::in_any_schedule_of_ticks_nothing_moves_half_a_second_after_the_owners_last_sign_of_life",
        "time::a_living_owner_is_not_lost_by_a_pause_of_ours",
        "core/supervision/lease::in_any_schedule_of_ticks_nobody_moves_anything_350_ms_after_its_last_sign_of_life",
        "core/supervision/lease::in_any_schedule_of_ticks_a_living_owner_is_not_lost",
        "e2e/stopping::a_daemon_that_is_always_late_loses_a_vanished_owner_in_time",
    ),
    "nobody else is the owner": (
        "api/identities::the_first_command_binds_an_id_to_its_secret",
        "api/identities::a_stranger_under_the_owners_id_is_nobody",
        "api/identities::made_up_clients_take_no_place_from_the_owner",
        "e2e/stopping::nobody_commands_under_the_owners_id",
    ),
    "a user's role, at a port with `local.roles_file`": (
        "api/access/roles::each_role_on_every_request_and_key",
        "api/access/roles::only_who_may_command_puts_targets_and_keepalives",
        "core/requests/handler::only_an_admin_takes_the_robot_by_force",
        "core/requests/handler::an_operator_undoes_no_stop_of_somebody_else",
        "core/requests/handler::only_an_admin_lets_a_silent_stop_endpoint_go",
        "core/requests/handler::no_role_keeps_a_stop_away",
    ),
    "the audit log's disk is full, or hangs": ("api/access/audit::a_person_stops_while_the_disk_is_full_or_hangs",),
}

ROBOT_SIDE = {
    "PAUSE, or READY -> SLOW_START": (
        "robot_side::a_robot_that_pauses_by_itself_is_held_in_pause",
        "robot_side::a_pause_too_short_to_be_seen_is_a_pause",
    ),
    "a paused robot's target is where it is": (
        "pausing::from_the_tick_of_a_pause_on_the_reference_is_where_the_arm_is",
        "pausing::an_arm_that_is_led_away_in_a_pause_takes_its_reference_along",
        "pausing::a_pause_keeps_the_reference_of_an_arm_that_is_not_heard",
        "pausing::a_pause_keeps_the_reference_of_an_arm_beyond_its_limits",
        "pausing::one_arm_that_is_disabled_in_a_pause_leaves_the_other_where_it_is",
        "pausing::a_robot_that_is_only_not_heard_to_run_is_braked",
        "pausing::while_a_heartbeat_is_not_heard_the_echo_stays_with_the_arm",
        "e2e/stopping::a_robot_that_pauses_by_itself_takes_its_references_along",
    ),
    "MODE_UNKNOWN": ("robot_side::an_unknown_mode_brakes_and_refuses_motion",),
    "VR mode, FSM 3-6": (
        "robot_side::vr_mode_gets_no_arm_frame_no_1_0_and_no_0_0",
        "robot_side::a_robot_that_plays_or_is_driven_by_vr_gets_nothing",
        "driving::nothing_drives_beside_vr_or_playback",
    ),
    "an arm is enabled again": (
        "enabling::an_arm_that_is_enabled_again_joins_only_at_the_next_enable",
        "enabling::an_arm_that_joins_may_be_followed_at_once_by_the_next_request",
        "enabling::an_arm_joins_only_from_a_steady_state",
    ),
    "mixed control modes": (
        "enabling::only_arms_that_are_enabled_are_streamed",
        "poses::each_arm_of_a_mixed_robot_is_streamed_in_its_own_space",
        "poses::a_pose_stream_starts_within_a_millimetre_of_the_measured_pose",
        "poses::poses_are_sent_at_70_hz_in_intervals_of_one_length",
        "poses::a_pose_motion_arrives_within_5_mm_and_0_05_rad_for_half_a_second",
        "poses::joints_of_one_arm_and_the_end_effector_of_the_other_move_at_once",
        "poses::a_stream_of_poses_is_followed_and_expires",
        "poses::what_is_no_pose_for_this_arm_is_refused",
        "poses::an_end_effector_brakes_along_its_way_and_is_held",
        "poses::a_takeover_in_mid_motion_goes_on_from_the_last_setpoint",
        "poses::a_short_stall_holds_the_pose_and_goes_on",
        "poses::an_end_effector_whose_pose_falls_silent_is_a_dead_part",
        "poses::an_end_effector_that_is_blocked_is_a_tracking_error",
        "poses::a_held_end_effector_walks_back_to_an_arm_that_was_led_away",
        "poses::an_arm_whose_mode_is_changed_while_it_is_streamed_is_let_go",
    ),
    "a jump is judged by our clock": (
        "jumping::a_jump_with_a_stamp_ahead_is_not_started_from",
        "jumping::a_stream_starts_from_samples_that_agree",
        "jumping::a_pause_is_left_only_when_the_samples_agree",
        "jumping::a_stream_does_not_start_where_the_end_effector_is_not",
        "jumping::an_end_effector_is_not_started_from_one_pose",
        "jumping::an_end_effector_joins_the_held_arm_not_by_one_pose",
        "core/robot_state/jumps::no_stamp_makes_a_jump_plausible",
        "core/robot_state/jumps::no_stall_of_the_link_makes_a_healthy_arm_incredible",
        "e2e/stopping::a_forged_sample_with_a_stamp_ahead_moves_no_arm",
    ),
    "measured jump, NaN, wrong length": (
        "link/codec::a_sample_larger_than_ours_is_refused_before_it_is_read",
        "surprises::samples_that_cannot_be_right_make_the_part_dead_in_every_state",
        "surprises::a_single_glitch_is_nothing_in_any_state",
        "surprises::an_arm_in_end_effector_mode_is_held_when_its_pose_cannot_be_right",
        "surprises::a_jump_while_holding_is_held_on_and_not_followed",
        "surprises::a_small_jump_is_within_what_an_arm_does",
        "surprises::a_jump_by_what_an_arm_can_do_in_the_time_is_believed",
        "surprises::after_a_jump_that_stays_a_stream_starts_where_the_arm_says_it_is",
        "surprises::a_mode_that_cannot_be_read_is_unknown_after_3_s_with_the_reason",
        "robot_side::samples_that_cannot_be_believed_are_counted_and_the_part_goes_dead_if_they_last",
    ),
    "duplicated and reordered stamps": ("surprises::stamps_that_repeat_jump_or_come_in_another_order_change_nothing",),
    "names in another order than §4.0.3": (
        "robot_side::joint_names_in_another_order_are_latched",
        "robot_side::joint_names_of_a_few_samples_latch_nothing",
    ),
    "robot restarted (new router zid)": (
        "losing_the_link::another_transport_is_a_lost_one",
        "surprises::a_robot_that_restarted_is_another_one_in_every_state",
    ),
    "FSM ERROR or foreign token while nothing of ours ran": (
        "others::an_announcement_while_nothing_of_ours_runs_is_a_condition",
        "robot_side::an_fsm_error_while_nothing_of_ours_ran_is_a_condition",
    ),
    "people hear of it once": ("robot_side::what_lasts_is_told_once",),
}

READINGS = {
    "READY": (
        "readings::arms_are_enabled_whether_or_not_ready_waits_for_their_commands",
        "readings::commands_that_are_lost_on_their_way_keep_such_a_robot_from_ready",
        "sim/robot/model::ready_waits_for_commands_of_each_enabled_arm_where_that_was_chosen",
    ),
    "joint values that stand still under fresh stamps": (
        "readings::joints_that_are_told_to_stand_still_end_the_motion_wherever_they_are",
        "sim/robot/model::what_is_told_of_a_stuck_joint_stays_under_fresh_stamps",
        "cli/check/faults::a_fault_fails_its_trial",
    ),
}

BRIDGE = {
    "state dead, transport up, tokens there, admin shows no DDS reader": (
        "link/discovery/route_watch::a_silent_announced_route_without_a_reader_is_dead_and_revived",
        "link/discovery/route_watch::attempts_back_off",
        "link/discovery/route_watch::never_more_than_four_revivals_a_minute",
        "link/discovery/route_watch::the_remedy_names_who_else_subscribes",
        "link/discovery/discovery::who_may_keep_a_route_dead_is_named_with_the_address",
        "link/robot_link::a_dead_route_is_revived",
        "core/engine::a_dead_route_is_told_and_a_live_one_is_not",
        "losing_the_link::stale_is_entered_when_the_newest_state_is_older_than_100_ms",
    ),
    "state dead, transport up, tokens gone": (
        "link/discovery/route_watch::silence_without_an_announcement_is_a_lost_route",
        "link/discovery/route_watch::what_was_never_announced_since_the_transport_opened_is_no_lost_route",
        "link/discovery/route_watch::a_route_that_comes_late_is_alive_and_lost_when_it_goes",
        "link/discovery/discovery::all_topics_lost_at_once_are_all_observed_without_a_question",
        "link/robot_link::a_node_that_leaves_is_a_lost_route_until_it_returns",
    ),
    "state N times": (
        "core/robot_state/duplication::every_sample_three_times_is_told_once_with_the_count",
        "core/engine::a_bridge_that_delivers_everything_twice_is_told_once",
    ),
    "another namespace than ours": (
        "link/discovery/robots::a_robot_is_who_announces_its_state_machine_and_an_arm",
        "link/discovery/discovery::a_robot_under_another_namespace_is_told_once_when_none_is_under_ours",
        "link/discovery/discovery::what_is_under_our_own_namespace_or_was_heard_is_our_robot",
        "diagnosis::a_robot_under_another_namespace_is_offered_and_several_are_listed",
        "link/surveyor::of_several_robots_none_is_taken",
        "e2e/link::a_robot_with_a_namespace_is_found_offered_and_driven",
    ),
    "two robots under one namespace": (
        "link/discovery/discovery::several_bridges_that_announce_a_robot_under_our_namespace_are_told_at_once",
        "diagnosis::beside_a_second_robot_under_our_namespace_nothing_begins",
    ),
    "1.0 out > 1.5 s, FSM stays PAUSE": (
        "enabling::a_heartbeat_that_does_nothing_is_told_once_with_what_is_known_of_its_way",
    ),
}

WHY = {
    "preconditions": (
        "preconditions::every_combination_is_refused_with_the_right_code_and_remedy",
        "preconditions::every_row_of_the_oracle_matters",
        "preconditions::the_states_of_the_situations_are_all_there_are",
    ),
    "a code for each of eight faults": (
        "diagnosis::a_fault_is_recognised_within_1_s_of_its_first_symptom",
        "diagnosis::the_numbers_of_a_finding_are_facts",
        "diagnosis::the_first_thing_that_fails_is_told_as_a_notice_once",
        "diagnosis::a_finding_ends_with_its_symptom",
        "diagnosis::why_an_enabling_failed_is_told_until_something_else_happens",
        "diagnosis::a_route_that_discovery_says_is_bad_is_suspected",
        "diagnosis::a_silence_of_everything_is_one_finding",
        "others::why_says_who_else_commands_the_robot",
    ),
    "no false alarm": (
        "diagnosis::an_end_effector_that_follows_is_no_refusal",
        "diagnosis::nothing_is_said_in_an_hour_of_nominal_use",
        "diagnosis::a_part_that_is_switched_off_may_be_silent",
        "diagnosis::a_topic_that_never_came_is_told_after_the_links_first_seconds",
        "diagnosis::without_a_link_nothing_is_inferred",
    ),
    "what pulls at its arms?": (
        "core/robot_state/contact::what_pulls_at_an_arm_is_told_with_how_sure_it_is",
        "core/robot_state/contact::without_efforts_nothing_is_known",
        "core/robot_state/contact::whatever_can_be_meant_of_efforts_makes_numbers",
        "core/robot_state/contact::while_the_model_cannot_be_relied_on_nothing_is_known",
        "core/robot_state/contact::old_joints_say_nothing_about_now",
        "core/robot_state/contact::another_robot_is_observed_from_its_beginning",
    ),
    "what does a hand hold?": (
        "core/robot_state/contact::a_load_is_counted_on_from_when_it_is_said_until_the_robot_is_lost",
        "core/requests/weighing::only_the_owner_says_or_asks",
        "core/requests/weighing::a_load_that_nobody_believes_is_refused_with_its_bound",
        "client/weighing::a_load_is_found_to_a_tenth_beside_the_empty_hand_and_is_no_longer_felt",
        "client/weighing::what_the_hand_holds_outlives_its_owner_and_goes_with_the_link",
        "client/weighing::a_stop_of_anybody_ends_the_weighing_and_nothing_is_counted_on",
    ),
    "`until=contact(...)`": (
        "core/requests/touches::what_would_not_feel_its_touch_does_not_begin",
        "core/requests/touches::without_dynamics_nothing_can_be_asked_to_end_at_a_touch",
        "core/requests/touches::when_nothing_is_known_any_more_the_arm_brakes_and_holds_and_says_why",
        "core/body/feeler::a_wish_that_means_nothing_is_refused_with_value_bound_and_remedy",
    ),
    "a touch": (
        "core/requests/touches::a_touch_ends_the_motion_and_the_arm_brakes_in_that_tick",
        "core/requests/touches::a_push_that_may_be_noise_counts_when_it_stays",
        "core/requests/touches::chunks_and_streams_end_at_a_touch_for_good",
        "core/requests/touches::the_hand_goes_back_along_the_way_it_came_by_what_was_asked",
        "core/requests/touches::whatever_ends_a_motion_ends_the_way_back",
        "sim/physics/touches::a_table_is_found_within_30_ms_and_15_n_at_a_tenth_of_a_metre_a_second",
        "sim/physics/touches::free_motion_at_full_speed_is_no_touch",
    ),
    "under way at the touch": (
        "core/requests/touches::"
        "what_was_asked_for_without_knowing_of_the_touch_neither_ends_the_way_back_nor_moves_the_arm",
        "core/requests/touches::who_knows_of_the_touch_may_go_on_at_once_and_who_feels_nothing_always",
    ),
    "`left_touch_n`, `right_touch_n`": (
        "core/requests/touches::"
        "the_gateways_own_bound_ends_whatever_moves_the_arm_and_refuses_what_follows_for_a_while",
        "core/requests/touches::one_can_move_away_from_what_pushes_a_held_arm_but_not_further_into_it",
        "core/requests/touches::where_nothing_is_known_the_own_bound_holds_nobody_back_and_that_is_told_once",
    ),
    "is it this robot's body?": (
        "model::a_nominal_robot_agrees_within_two_seconds",
        "model::a_nominal_robot_agrees_however_fast_it_moves",
        "model::another_body_is_told_within_five_seconds_and_over_as_soon",
        "model::a_new_link_ends_in_nothing_known",
        "model::without_poses_nothing_is_known",
        "model::a_robot_that_differs_agrees_after_it_was_identified",
        "core/robot_state/body_model::a_robot_of_our_numbers_may_be_moved_by_them",
        "core/robot_state/body_model::another_robot_is_told_with_figure_and_bound",
    ),
}

ELSE = {
    "what counts": (
        "others::nothing_of_our_own_is_an_alarm",
        "core/others/others::sessions_of_ours_are_never_foreign",
        "core/others/others::publishers_of_another_gateway_are_no_writers",
        "link/others/foreign_watch::a_sample_on_a_key_with_wildcards_is_told_as_all_the_commands_that_it_is",
        "link/others/foreign_watch::a_bridge_that_declares_publishers_for_everything_commands_nothing",
        "interop/ros_user::a_host_that_only_looks_keeps_no_gateway_from_commanding",
    ),
    "foreign data": (
        "others::foreign_arm_data_ends_our_frames_in_the_next_tick",
        "others::a_0_0_is_owed_only_when_our_1_0_was_out",
        "others::a_repetition_of_0_0_ends_with_foreign_data",
        "others::foreign_chassis_data_brakes_the_arms_and_latches",
        "others::recover_waits_until_the_foreign_writer_is_gone",
    ),
    "policy `warn`": ("others::under_warn_others_are_told_of_and_stop_nothing",),
    "another gateway": (
        "others::another_armed_gateway_takes_our_frames_off_without_0_0",
        "others::a_gateway_that_is_only_connected_is_no_rival",
        "others::whoever_acquires_is_told_nothing_wrong",
        "others::stopping_is_possible_beside_others",
    ),
}

MOTIONS = {
    "grippers": (
        "gripping::a_command_without_its_arm_is_refused_with_the_reason",
        "gripping::a_command_of_before_a_stop_changes_nothing",
        "gripping::whether_something_is_held_is_estimated_and_shown",
        "gripping::frames_of_grippers_are_holds_but_for_the_owners",
        "gripping::a_gripper_goes_with_an_arm_in_end_effector_mode_as_well",
    ),
    "point to point": (
        "motions::a_motion_is_queued_then_executed_with_progress_then_reached",
        "motions::all_joints_of_both_arms_end_together",
        "motions::a_relative_motion_counts_from_the_reference",
        "motions::a_motion_that_cannot_be_is_refused_and_the_running_one_goes_on",
        "motions::a_motion_that_finds_no_path_leaves_the_running_one_alone",
        "motions::clipping_is_opt_in_and_reported",
        "motions::a_later_motion_supersedes_the_earlier_one_without_a_stop",
        "motions::each_arm_may_have_a_motion_of_its_own",
    ),
    "a hand that yields": (
        "core/requests/admitting::a_hand_goes_where_it_is_pushed_and_only_while_its_client_is_there",
        "core/requests/admitting::without_a_push_nothing_moves",
        "core/requests/admitting::an_axis_that_the_posture_does_not_feel_is_pushed_by_nothing",
        "core/requests/admitting::once_nobody_knows_what_pulls_it_brakes_and_says_why",
        "core/requests/admitting::it_is_refused_at_once_where_nobody_knows_what_pulls",
        "core/requests/admitting::it_is_refused_where_nobody_asked_for_dynamics",
        "core/limits/admittance_rules::what_would_swing_is_refused_with_value_bound_unit_and_remedy",
        "core/motion/poses/admittance::held_by_what_is_stiff_it_does_not_swing_whatever_its_mass_and_spring",
        "core/motion/poses/admittance::let_go_it_comes_to_rest_without_turning_round",
        "core/motion/poses/admittance::a_spring_leads_it_home_without_overshoot",
    ),
    "streamed targets": (
        "streaming::targets_of_any_rate_become_a_smooth_100_hz_stream",
        "streaming::a_stream_starts_at_the_present_reference",
        "streaming::targets_outside_the_limits_are_refused_or_clipped_as_asked",
        "streaming::a_target_that_is_no_target_is_refused",
        "streaming::an_older_target_is_never_followed",
        "streaming::another_client_cannot_push_a_target_out_of_its_slot",
        "streaming::a_target_under_another_epoch_is_refused",
        "streaming::a_stream_that_ended_takes_no_targets_and_says_why",
        "streaming::a_stream_takes_its_arm_out_of_a_motion_of_two",
        "streaming::a_stream_says_when_its_targets_ask_for_too_much",
    ),
    "a pose of an arm in joint mode": (
        "core/requests/cartesian::a_joint_arm_goes_to_a_pose_by_its_joints_at_once",
        "core/requests/cartesian::without_a_model_there_are_no_poses_for_joint_arms",
        "core/requests/cartesian::a_pose_that_no_joints_take_names_a_joint",
        "core/requests/cartesian::a_joint_motion_to_a_pose_ends_when_the_model_differs",
    ),
    "a straight way": (
        "core/requests/cartesian::a_straight_motion_waits_while_it_is_worked_out_and_then_goes_straight",
        "core/requests/cartesian::what_moved_an_arm_ends_and_the_line_begins_where_it_came_to_rest",
        "core/requests/cartesian::a_motion_that_is_worked_out_can_be_ended_as_any_other",
        "core/requests/cartesian::a_line_that_cannot_be_followed_ends_aborted_and_nothing_moves",
        "core/requests/cartesian::a_tick_does_no_more_than_some_pieces",
        "core/requests/cartesian::a_stop_on_the_way_brakes_inside_the_limits",
        "core/requests/cartesian::a_model_that_differs_ends_the_motion",
        "core/motion/lines/line_clock::no_limit_of_a_joint_is_exceeded_at_any_instant",
        "core/motion/lines/line_clock::two_arms_share_the_clock_of_the_slower_one",
        "core/motion/lines/line_clock::a_line_for_which_joints_are_too_slow_is_refused_with_the_worst_place",
        "core/motion/lines/line_curve::a_line_on_which_a_joint_leaves_its_limits_is_refused_with_the_place",
        "core/motion/lines/line_curve::a_wrist_beyond_the_reach_is_told_where",
        "core/motion/lines/line_path::setpoints_are_straight_and_keep_the_limits",
        "core/motion/lines/line_plan::joints_that_turn_too_sharply_are_refused",
        "./line_invariants::no_trace_with_motion_by_the_model_breaks_an_invariant",
        "e2e/linear::both_hands_go_straight_in_joint_mode",
    ),
    "a stream of poses near a singular posture": (
        "core/separation/slowing::the_bound_is_kept",
        "core/separation/slowing::a_calm_way_into_a_stretched_arm_and_out_of_it_is_slow_and_arrives",
        "core/separation/slowing::from_a_singular_posture_every_direction_is_left",
        "core/separation/slowing::away_from_singularities_not_a_bit_of_a_setpoint_is_another",
        "core/separation/slowing::while_the_model_does_not_agree_it_is_off_and_that_is_told",
        "core/separation/slowing::only_streams_of_poses_are_looked_at",
        "core/output/diagnosis::poses_that_are_followed_slower_near_a_singularity_are_told",
        "./slowed::joints_of_a_robot_with_an_ik_of_its_own_keep_the_bound",
        "./slowed::a_model_that_no_longer_agrees_ends_it_in_the_middle_and_tells",
    ),
}

APART = {
    "a goal too near": (
        "core/separation/goal_checks::a_goal_inside_the_margin_is_refused_with_pair_distance_bound_and_remedy",
        "core/separation/goal_checks::of_a_pose_only_what_it_places_is_judged",
        "core/separation/goal_checks::the_other_arm_is_looked_at_where_it_is_bound_for",
        "core/separation/goal_checks::what_is_inside_the_margin_already_may_part_and_not_come_nearer",
        "core/requests/moves::a_goal_where_the_arms_would_meet_is_refused_and_what_is_under_way_goes_on",
        "core/requests/follows::a_chunk_that_ends_where_the_arms_would_meet_is_refused",
        "core/requests/cartesian::a_goal_that_leaves_too_little_room_is_refused_before_anything_ends",
    ),
    "the way to a pose": (
        "core/requests/cartesian::a_way_on_which_parts_come_too_near_is_refused_and_a_free_one_is_gone",
        "core/requests/cartesian::an_arm_that_nobody_knows_stands_in_the_way",
        "core/motion/lines/line_gaps::it_finds_what_looking_at_every_posture_finds",
        "core/motion/lines/line_gaps::a_refusal_names_both_parts_the_gap_and_the_margin",
    ),
    "a motion or a chunk that leads too near": (
        "core/separation/spacing::a_path_that_leads_into_the_other_arm_ends_for_both_arms_with_what_is_ahead",
        "core/separation/spacing::a_trajectory_that_leads_into_the_other_arm_ends_and_the_arm_brakes",
        "core/separation/spacing::a_motion_past_everything_is_reached",
        "./kept_apart::random_moves_end_at_their_goals_or_before_anything_is_touched",
        "./kept_apart::poses_of_an_arm_in_joint_mode_are_kept_apart_like_any_path",
    ),
    "a stream that leads too near": (
        "core/separation/spacing::a_stream_is_slowed_down_then_held_back_and_told_of_once",
        "core/separation/spacing::a_stream_that_is_held_back_again_later_is_told_of_again",
        "core/separation/spacing::only_joints_that_close_a_gap_are_held_back",
        "core/separation/spacing::what_is_caught_between_two_parts_can_be_led_out_again",
        "./kept_apart::without_it_these_targets_are_a_collision",
        "./kept_apart::arms_that_stream_towards_each_other_stop_with_two_centimetres_left_and_part_again",
        "./kept_apart::random_targets_at_any_limits_keep_the_margin",
        "e2e/spacing::both_hands_that_are_led_together_stop_before_they_meet",
    ),
    "stops, holds, walks": (
        "core/separation/spacing::a_brake_goes_on_whatever_is_ahead",
        "core/separation/spacing::a_walk_back_to_the_arm_is_never_held_back",
        "./kept_apart::a_stop_near_the_other_arm_is_a_stop_as_quick_as_ever",
    ),
    "an arm in end-effector mode": (
        "core/separation/goal_checks::an_arm_in_end_effector_mode_is_not_moved_by_poses_while_arms_are_kept_apart",
        "core/separation/spacing::an_arm_in_end_effector_mode_is_an_obstacle_where_it_is_measured",
        "core/separation/spacing::an_arm_that_moves_by_itself_has_the_room_that_it_may_take",
        "core/separation/spacing::what_moves_an_arm_by_poses_ends_when_arms_are_kept_apart_again",
    ),
    "the model does not agree": (
        "core/separation/goal_checks::it_is_off_where_nobody_asks_for_it_and_while_the_model_is_not_known",
        "core/separation/spacing::it_is_told_once_that_arms_move_and_are_not_kept_apart_and_once_that_they_are_again",
        "core/separation/spacing::arms_that_stand_are_no_reason_to_say_anything",
    ),
    "off, or nothing near": (
        "core/separation/spacing::without_being_asked_for_nothing_is_looked_at",
        "./kept_apart::where_it_is_off_and_where_nothing_is_near_not_a_bit_of_a_setpoint_is_another",
    ),
}

GUARD = {
    "its own process and session": (
        "core/supervision/enabling::the_guards_session_is_open_before_the_first_frame",
        "e2e/guard::other_gateways_are_kept_away_until_the_last_stop_frame",
    ),
    "death and freeze": (
        "guard::ticks_missing_for_80_ms_are_a_freeze_and_the_hold_goes_on",
        "e2e/guard::a_dead_daemon_is_followed_by_a_hold_and_the_next_daemon_takes_it",
        "core/handover/freeze::ticks_missing_for_80_ms_are_a_freeze",
        "core/handover/freeze::a_guard_that_was_late_itself_counts_anew",
        "core/handover/freeze::a_daemon_with_nothing_on_the_wire_is_never_frozen",
        "core/handover/freeze::a_core_that_stands_still_is_no_freeze_of_its_daemon",
        "core/handover/freeze::a_daemon_that_waits_behind_others_after_its_core_came_back_lives",
        "core/handover/freeze::turns_that_come_too_rarely_are_judged_in_the_end",
        "guard/starvation::who_could_run_and_has_not_run_since_waits",
        "guard/starvation::who_does_not_want_to_run_waits_for_no_core",
        "guard/starvation::a_thread_behind_one_that_spins_waits_for_no_turn_of_the_process",
        "e2e/guard::a_core_that_stands_still_is_no_frozen_daemon",
        "e2e/guard::a_daemon_without_real_time_that_is_starved_is_no_frozen_one",
        "e2e/guard::a_daemon_without_real_time_that_stands_still_is_ended_in_time",
        "core/guardian::a_daemon_that_has_been_dead_for_a_second_leaves_nothing_to_do",
        "core/guardian::a_guard_that_stood_still_for_a_second_sends_nothing_any_more",
    ),
    "holds only": (
        "guard::a_last_frame_of_150_ms_ago_is_not_gone_on_with",
        "core/handover/takeover::what_the_robot_says_against_a_hold",
        "core/handover/takeover::from_no_other_state_a_hold_goes_on",
    ),
    "while it holds": (
        "guard::a_holding_guard_is_silent_in_vr_mode_and_beside_another_fsm",
        "guard::a_holding_guard_answers_a_pause_with_0_0",
        "guard::a_holding_guard_does_not_wait_out_a_stall",
        "guard::the_last_word_of_a_guard_whose_robot_falls_silent_is_0_0",
    ),
    "stop-only": (
        "guard::stop_and_estop_work_while_the_daemon_is_dead",
        "e2e/guard::stop_and_estop_work_while_the_daemon_is_dead",
    ),
    "a stop gets through": (
        "guard/guard_server::a_stop_is_its_arrival_however_it_is_written",
        "guard/guard_server::idle_callers_shut_nobody_out",
        "guard/guard_server::the_busiest_process_of_the_busiest_user_makes_room",
        "guard/guard_server::one_look_lets_in_so_many_and_no_more",
        "guard/guard_server::a_caller_that_never_reads_delays_nobody",
        "guard/guard_server::a_stop_that_is_read_with_the_question_for_the_hold_is_carried_out_first",
        "guard/guard_server::500_hostile_connections_of_one_process_do_not_keep_a_stop_away",
    ),
    "who is given the hold": (
        "guard/guard_server::only_the_daemons_user_and_root_are_given_the_hold",
        "guard/guard_server::no_hold_is_taken_from_another_users_guard",
        "guard/guard_server::the_heir_and_a_stop_under_way_keep_their_places",
        "guard/guard_server::the_next_daemon_keeps_its_place_while_it_waits",
    ),
    "a restarted daemon": (
        "guard::a_restarted_daemon_takes_the_hold_over_as_unowned_with_the_60_s_anew",
        "guard::a_restarted_daemon_enables_nothing_while_the_guard_holds",
        "guard::a_hold_taken_over_while_a_lost_owner_has_the_lease_ends_after_60_s",
        "guard/guard_server::an_estop_at_the_guard_while_the_next_daemon_waits_is_latched_there",
        "guard::an_estop_between_the_question_for_a_hold_and_its_answer_ends_it",
        "core/guardian::a_hold_whose_new_daemon_hangs_goes_down",
        "core/handover/takeover::what_was_latched_stays_latched",
        "e2e/guard::a_hold_outlives_a_daemon_that_dies_before_it_has_taken_it",
    ),
    "guard dead": (
        "guard::a_lost_guard_is_told_and_control_goes_on",
        "e2e/guard::a_killed_guard_is_told_another_is_started_and_control_goes_on",
        "guard/launcher::a_guard_that_hangs_is_none_and_is_ended",
        "guard/launcher::a_guard_is_not_said_to_hang_by_who_was_kept_from_looking_himself",
    ),
    "in each space": (
        "guard::an_arm_in_end_effector_mode_is_braked_held_and_handed_over_like_the_other",
        "e2e/guard::an_arm_in_each_control_mode_is_held_and_handed_over",
        "guard::a_dead_daemons_arms_are_braked_and_held_for_10_s",
    ),
    "no guard, or both dead": ("e2e/guard::with_both_killed_the_robots_own_watchdogs_act",),
    "a normal end": ("e2e/guard::a_normal_end_is_no_reason_to_hold",),
    "who else commands": (
        "guard/guard::what_others_command_is_heard_from_the_first_doubt_on",
        "link/others_on_the_wire::who_hears_no_commands_does_so_as_soon_as_it_wants_to_and_after_the_next_connecting",
        "e2e/guard::a_guard_that_holds_lets_go_when_somebody_else_commands",
    ),
}

DOORS = {
    "a lock of another user": (
        "api/instance_lock::another_users_closed_file_does_not_block_the_start_for_ever",
        "api/instance_lock::another_users_closed_file_counts_while_a_process_holds_it",
        "api/instance_lock::two_real_users",
    ),
    "a port on this host": (
        "api/listener::on_this_host_nobody_connects_unknown_but_in_words",
        "api/listener::the_word_for_everybody_is_for_loopback_and_stands_beside_no_users",
        "api/service::a_port_on_this_host_that_asks_nobody_is_refused_at_start",
    ),
    "a port beyond it": (
        "api/listener::beyond_this_host_nobody_connects_unknown",
        "api/listener::beyond_this_host_users_need_tls",
    ),
}

ENDPOINTS = {
    "silence": (
        "watching::silence_ends_anybodys_motion_within_the_period",
        "watching::what_an_endpoint_does_in_each_state",
        "watching::an_endpoint_whose_connection_ends_is_silent_at_once",
        "watching::each_endpoint_is_judged_by_itself",
        "watching::chassis_and_grippers_stand_still_too",
        "watching::a_late_tick_is_no_silence_of_an_endpoint",
        "watching::no_schedule_of_late_ticks_lets_motion_outlive_an_endpoint",
        "e2e/watching::an_endpoint_that_dies_or_stops_holds_somebody_elses_motion",
        "e2e/watching::a_terminal_that_watches",
    ),
    "heard again": ("watching::nothing_resumes_by_itself_when_an_endpoint_is_heard_again",),
    "leaving": (
        "watching::what_goes_on_goes_on_when_an_endpoint_leaves_in_order",
        "watching::recover_lets_silent_endpoints_go_and_needs_a_reason",
        "e2e/watching::an_endpoint_that_leaves_in_order_stops_nothing",
    ),
    "demanded": (
        "watching::where_one_is_demanded_nothing_moves_without",
        "watching::where_one_is_demanded_recover_walks_nothing_without",
    ),
    "restart": ("watching::the_next_daemon_waits_for_a_person_who_says_why",),
}

THREADS = {
    "a part of the daemon ended": (
        "threads::a_daemon_that_lost_a_thread_brakes_and_leaves_the_hold_to_its_guard",
        "threads::without_a_guard_it_ends_as_if_it_had_been_asked_to",
        "threads::where_nothing_is_held_the_guard_has_nothing_to_go_on_with",
        "threads::a_guard_that_has_only_just_come_is_waited_for",
        "threads::a_guard_that_dies_meanwhile_is_not_left_alone_with_the_robot",
        "threads::arms_that_need_long_to_brake_are_braked_on_by_the_guard",
        "threads::a_short_stall_is_waited_out_before_the_hold_is_left",
        "e2e/threads::no_thread_ends_alone",
    ),
    "a stop meanwhile": ("threads::whoever_stops_is_obeyed_to_the_last_and_nobody_moves_it_any_more",),
    "restart": ("threads::the_latch_survives_a_restart_and_only_recover_clears_it",),
}

FORCES = {
    "the same rules": (
        "sim/physics/bodies::it_starts_hanging_and_comes_to_ready_by_the_same_rules",
        "sim/physics/bodies::a_silent_stream_brakes_the_arm_and_holds_no_position",
        "sim/physics/bodies::the_grip_is_lost_100_ms_after_the_arm_s_stream",
        "sim/physics/bodies::a_spoiled_chassis_still_stops",
    ),
    "motion inside the limits": (
        "sim/physics/with_the_gateway::home_is_reached_at_full_speed_without_a_latch",
        "sim/physics/with_the_gateway::the_fastest_limits_stay_within_the_bound_on_the_tracking_error",
        "sim/physics/with_the_gateway::stop_brings_the_arms_to_rest_where_they_are",
    ),
    "an arm that meets something": (
        "sim/physics/with_the_gateway::an_arm_that_meets_the_table_is_stopped_by_the_bound_on_the_tracking_error",
    ),
    "a machine that is too slow": (
        "sim/physics/bodies::a_machine_that_is_too_slow_loses_time_of_physics_and_says_so",
        "sim/physics/bodies::slowness_is_told_at_once_then_twice_a_minute_with_the_worst_and_when_it_is_over",
    ),
    "numbers that run away": ("sim/physics/unstable::a_lost_world_is_one_line_and_exit_status_1",),
}

RELOADING = {
    "a setting that needs a restart, a wrong file": (
        "reloading::what_is_refused_changes_nothing_and_everybody_hears_of_it",
        "settings/reloading::what_is_taken_is_there_and_no_file_is",
        "settings/reloading::each_setting_alone_is_taken_or_named",
        "settings/reloading::one_that_needs_a_restart_keeps_all_others_from_being_taken",
        "e2e/reloading::a_limit_is_lowered_in_mid_motion_and_a_broken_file_changes_nothing",
    ),
    "what is under way": (
        "reloading::nothing_on_the_wire_changes_by_a_reading",
        "reloading::a_motion_under_way_ends_as_it_began_and_the_next_one_obeys",
        "reloading::an_endpoint_that_is_demanded_from_now_on_ends_nothing_that_moves",
    ),
    "a lower speed limit": (
        "reloading::a_motion_that_takes_over_from_a_faster_one_brakes_to_the_new_limit",
        "reloading::a_stream_under_way_brakes_to_the_new_limit_with_its_next_target",
        "reloading::a_chassis_that_is_too_fast_now_ramps_down_when_its_velocity_expires",
        "reloading::a_limit_that_is_raised_again_is_that_of_the_next_motion",
        "settings/reloading::a_speed_limit_is_lowered_and_raised_up_to_that_of_the_start",
    ),
    "a file that hangs, a pipe, a storm of signals": (
        "settings/reloading::what_is_no_file_is_an_error_and_never_waited_for",
        "process/reloading::however_often_it_is_asked_for_one_more_reading_is_enough",
        "process/reloading::a_disk_that_hangs_keeps_nobody_waiting",
    ),
    "what reads it ends": (
        "process/reloading::what_ends_the_thread_is_told_and_it_is_begun_anew_once",
        "e2e/reloading::a_limit_is_lowered_in_mid_motion_and_a_broken_file_changes_nothing",
    ),
    "the terminal is gone": ("process/daemon::a_terminal_that_is_gone_is_an_end_and_the_same_signal_else_a_reading",),
}

INDEX: dict[str, dict[str, tuple[str, ...] | str]] = {
    "Values": VALUES,
    "Transitions": TRANSITIONS,
    "Starting and continuing": STARTING,
    "Stopping and losing": STOPPING,
    "The guard": GUARD,
    "The robot does something by itself": ROBOT_SIDE,
    "Where the manual can be read in two ways": READINGS,
    "The bridge misbehaves": BRIDGE,
    "Somebody else": ELSE,
    "What the owner moves": MOTIONS,
    "Arms kept apart": APART,
    "Why the robot does not do what it is told": WHY,
    "Doors": DOORS,
    "Stop endpoints": ENDPOINTS,
    "Threads": THREADS,
    "The simulated robot with forces": FORCES,
    "Settings read anew": RELOADING,
}
"""Section -> row -> tests; a text instead names the folder that has the row. The row in brackets is about
the page itself."""
