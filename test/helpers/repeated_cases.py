"""What `make test` leaves to `make thorough` because another case shows it in part."""

from __future__ import annotations

USUAL_METHODS = {"direct", "klt", "akaze"}  # of the contract of methods
ONE_CASE = {  # parametrised tests of which the first case stands for the others
    # flights, each with another trap, fault, scene or size of the same motion
    "test_a_bank_along_the_rows_above_the_plane_is_no_rolling_shutter",
    "test_a_damaged_first_picture_is_given_up_within_the_start",
    "test_a_fault_in_the_stream_loses_no_more_than_it_must", "test_a_glitch_within_the_start_costs_itself_alone",
    "test_a_jump_is_found_at_once", "test_a_path_is_followed_within_a_few_sigma", "test_a_plane_raises_no_alarm",
    "test_a_river_without_swing_is_answered_as_if_it_were_not_looked_for",
    "test_a_step_in_the_ground_is_told_with_its_direction", "test_a_turn_that_the_reference_cannot_follow",
    "test_damaged_pictures_after_a_good_reference_cost_themselves_alone", "test_no_flight_is_far_off_in_silence",
    "test_rigid_water_is_never_followed", "test_rows_that_swing_are_corrected", "test_sigma_is_honest_over_a_flight",
    "test_boards_are_seen_where_the_truth_says", "test_control_points_place_a_moving_camera",
    # noise of other kinds, and other models of the camera
    "test_noise_is_not_found_again_in_noise", "test_random_noise_is_lost", "test_displacements_are_as_sure_as_said",
    "test_claimed_sigma_is_honest_among_outliers", "test_ed_ransac_s_sigma_is_honest_however_much_it_drops",
    # residuals of other sizes and over other grounds
    "test_a_known_residual_is_recovered", "test_a_residual_is_recovered", "test_a_camera_on_a_tripod_keeps_its_points",
    "test_what_is_not_stabilised_at_all_never_stands_still",
    "test_sigma_grows_when_the_picture_gets_worse", "test_text_in_the_picture_is_not_the_ground",
    "test_a_camera_that_stands_still_sees_ground_at_rest", "test_texture_moves_with_a_uniform_flow",
    "test_the_slope_is_the_velocity_also_over_a_standing_pattern",
    "test_a_change_of_brightness_is_told_and_not_taken_for_motion", "test_a_plain_search_of_the_whole_picture_agrees",
    "test_water_that_moves_as_one_does_not_count",
    "test_exact_points_give_the_exact_camera_from_nothing",
    # methods and models that take the same way through the stabiliser
    "test_after_a_loss_the_same_reference_holds", "test_homographies_stay_in_the_model",
    "test_new_settings_keep_the_reference", "test_wrong_settings_change_nothing",
    "test_a_lost_frame_never_becomes_the_base", "test_homographies_and_pictures_are_the_same",
    "test_sigma_grows_from_frame_to_frame", "test_the_same_frames_give_the_same_numbers",
    "test_the_reason_names_what_the_frame_lacks", "test_with_the_camera_a_distorted_scene_is_tracked_to_the_truth",
    # commands and nodes that read other inputs, or end at other moments, by the same code
    "test_a_full_disk_ends_with_1_and_leaves_the_readable_part", "test_interrupted_demo_leaves_no_process",
    "test_live_gives_what_the_command_gives", "test_what_another_tool_has_stabilised", "test_every_kind_of_input",
    "test_bad_arguments_are_one_line", "test_bad_parameters_are_one_line_and_exit_code_2", "test_signal_during_start",
    "test_there_is_one_clock_though_the_bag_holds_another", "test_water_level_holds_from_its_stamp_on",
    "test_output_that_goes_nowhere_leaves_no_traceback", "test_the_judge_is_that_of_evaluate",
    "test_the_twin_is_the_camera_of_the_picture", "test_compressed_images_are_placed_as_raw_ones",
    "test_bad_parameters_end_the_node", "test_what_is_no_quality_of_service_is_one_line",
    "test_the_tracker_beside_a_node_of_somebody_else_answers_as_the_engine", "test_every_size_has_points",
    "test_pairs_that_are_logged_out_of_order_are_all_measured", "test_density_stays_even",
    "test_a_pinhole_of_the_reference_sees_the_marks_there", "test_warped_by_oneself_as_image_stabilized",
    "test_pairs_by_stamp", "test_nodes_share_images_in_a_process_of_somebody_else",
    "test_frames_of_a_start_that_are_not_to_be_late",
    "test_a_pause_is_no_fault_of_the_stream", "test_without_a_start_it_is_given_up_after_some_frames",
    "test_errors_of_a_flight_with_control_points_in_its_reference_are_as_told",
    "test_errors_by_followed_control_points_are_as_told", "test_compressed_images_stay_grey",
    "test_a_stabilised_recording_gives_the_same_places",
}
